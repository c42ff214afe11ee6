"""Names that users import, repeated here so that none is lost by accident."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

import rtask
from rtask.graph import Changes, Graph
from rtask.kb.commit.transaction import Transaction
from rtask.remote.knowledge_base import RemoteKnowledgeBase, RemoteTransaction


def test_the_packages_public_names() -> None:
    assert sorted(rtask.__all__) == [
        *("KnowledgeBase", "Rule", "__version__", "connect", "errors", "open")
    ]
    for name in rtask.__all__:
        assert getattr(rtask, name) is not None
    assert dir(rtask) == sorted(rtask.__all__)
    with pytest.raises(AttributeError, match="no attribute 'opne'"):
        rtask.opne  # noqa: B018


def test_the_knowledge_bases_public_names() -> None:
    public = {name for name in dir(rtask.KnowledgeBase) if not name.startswith("_")}
    assert public >= {
        "access",
        "backup",
        "base",
        "checkpoint",
        "close",
        "contradictions",
        "dump",
        "explain",
        "history",
        "load",
        "match",
        "may_write",
        "on_commit",
        "query",
        "rebuild",
        "select",
        "seq",
        "serialize",
        "session",
        "stats",
        "transaction",
        "update",
        "verify",
        "warm_up",
    }


def _members(protocol: type) -> set[str]:
    """Return the methods and properties of a protocol, ``with`` included."""
    dunder = {"__enter__", "__exit__"}
    return {name for name in vars(protocol) if not name.startswith("_") or name in dunder}


@pytest.mark.parametrize("kind", [rtask.KnowledgeBase, RemoteKnowledgeBase])
def test_embedded_and_remote_take_what_the_shared_interface_takes(kind: type) -> None:
    for name in _members(Graph):
        wanted = vars(Graph)[name]
        if isinstance(wanted, property):  # set for each object
            continue
        own = inspect.signature(getattr(kind, name)).parameters
        takes_any = any(p.kind is p.VAR_KEYWORD for p in own.values())
        missing = set(inspect.signature(wanted).parameters) - set(own) - {"options"}
        assert takes_any or not missing, f"{kind.__name__}.{name} lacks {missing}"


def test_both_transactions_have_the_shared_methods() -> None:
    for kind in (Transaction, RemoteTransaction):
        assert _members(Changes) <= set(dir(kind))


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = (
        "import sys, rtask; "
        "heavy = {'pyoxigraph', 'numpy', 'rdflib', 'numba', 'flask', 'httpx', 'reasoner'}; "
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    late = (
        "import sys, rtask.opening; assert not {'rdflib','pyhornedowl','numpy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", late], check=True)
