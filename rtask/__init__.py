"""A knowledge graph that robots share.

>>> import rtask
>>> with rtask.open(":memory:", plain=True) as kb:
...     _ = kb.update('INSERT DATA { <urn:mug> <urn:on> <urn:table> }')
...     [row["place"].value for row in kb.query("SELECT ?place { <urn:mug> <urn:on> ?place }")]
['urn:table']

Importing this package loads nothing heavy; what is not used is not imported.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, Literal, overload

from rtask import errors, shadowing

if TYPE_CHECKING:
    from pathlib import Path

    from rtask.client import Client
    from rtask.graph import Graph
    from rtask.kb.rules.rule import Rule
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["KnowledgeBase", "Rule", "__version__", "connect", "errors", "open"]

shadowing.check_packages()

# Gymnasium looks for no plugins since 1.0, so whoever has imported it is told our environments by
# name here; a program without it loads nothing more.
if sys.modules.get("gymnasium") is not None:
    from grasp.learning import registration

    registration.register()
    del registration

__version__: str  # read on first use: the processes that answer queries import this file, too


@overload
def open(target: Path | Literal[":memory:"], **options: Any) -> KnowledgeBase: ...


@overload
def open(target: str | Path, **options: Any) -> Graph: ...


def open(target: str | Path, **options: Any) -> Graph:
    """Open a knowledge base: a folder, ``":memory:"`` or the address of a SPARQL server.

    Parameters and errors: :func:`rtask.opening.open_knowledge_base`. Type checkers see a
    :class:`KnowledgeBase` for a ``Path`` or ``":memory:"``; other text may be the address of a
    server, so it gives a :class:`~rtask.graph.Graph`, which has the methods that both share.
    """
    from rtask.opening import open_knowledge_base

    return open_knowledge_base(target, **options)


def connect(target: Any, **options: Any) -> Client:
    """Connect a robot program: to a server by URL, or to an open knowledge base in process.

    Parameters and errors: :func:`rtask.client.connect`.
    """
    from rtask.client import connect as connect_client

    return connect_client(target, **options)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        import importlib.metadata

        globals()[name] = importlib.metadata.version("rtask-kg")
        return globals()[name]
    if name == "KnowledgeBase":
        from rtask.knowledge_base import KnowledgeBase

        return KnowledgeBase
    if name == "Rule":
        from rtask.kb.rules.rule import Rule

        return Rule
    raise AttributeError(f"module 'rtask' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
