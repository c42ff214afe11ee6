"""What users import is named here once more, so that a name is not lost by accident."""

from __future__ import annotations

import subprocess
import sys

import pytest

import rtask


def test_the_packages_public_names() -> None:
    assert sorted(rtask.__all__) == ["KnowledgeBase", "__version__", "connect", "errors", "open"]
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
