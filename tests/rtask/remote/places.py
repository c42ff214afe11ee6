"""Places for the statements of a knowledge base: memory, folder, SPARQL servers."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rtask
from rtask.errors import RtaskError
from rtask.knowledge_base import KnowledgeBase
from rtask.remote.store import RemoteStore
from tests import sparql_servers
from tests.sparql_servers import Oxigraph, SparqlServer, Virtuoso

__all__ = ["KINDS", "MAKERS", "TBOX", "Local", "OnServer", "opened", "remote_store", "texts"]

_WITHOUT_OXIGRAPH = pytest.mark.skipif(
    sparql_servers.OXIGRAPH is None, reason="no oxigraph server; pip install oxigraph"
)
_WITHOUT_VIRTUOSO = pytest.mark.skipif(
    sparql_servers.VIRTUOSO is None, reason="no Virtuoso; apt-get install virtuoso-opensource"
)
KINDS = [
    "memory",
    "folder",
    pytest.param("oxigraph", marks=_WITHOUT_OXIGRAPH),
    pytest.param("oxigraph-union", marks=_WITHOUT_OXIGRAPH),
    pytest.param("virtuoso", marks=_WITHOUT_VIRTUOSO),
]
MAKERS: dict[str, Callable[[Path], SparqlServer]] = {
    "oxigraph": Oxigraph,
    "oxigraph-union": lambda folder: Oxigraph(folder, union=True),
    "virtuoso": Virtuoso,
}

TBOX = (
    b"@prefix : <urn:t:> . @prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .\n"
    b":Mug rdfs:subClassOf :Vessel . :Vessel rdfs:subClassOf :Thing ."
)


class Local:
    def __init__(self, kind: str, root: Path) -> None:
        self._kind = kind
        self._root = root
        self._numbers = itertools.count()
        self._last = 0

    def open(self, again: bool = False, **options: Any) -> KnowledgeBase:
        if self._kind == "memory":
            if again:
                pytest.skip("nothing is left of a store in memory")
            target: Any = ":memory:"
        else:
            self._last = self._last if again else next(self._numbers)
            target = self._root / str(self._last)
        return opened(target, **{"base": "urn:lab/", **options})


class OnServer:
    def __init__(self, server: SparqlServer, root: Path) -> None:
        self._server = server
        self._root = root
        self._numbers = itertools.count()
        self._last = 0

    def open(self, again: bool = False, **options: Any) -> KnowledgeBase:
        if not again:
            self._last = next(self._numbers)
            _empty(self._server)
        folder = options.pop("folder", self._root / f"local-{self._last}")
        return opened(self._server.address, folder=folder, **{"base": "urn:lab/", **options})


def opened(target: Any, **options: Any) -> KnowledgeBase:
    kb = rtask.open(target, **{"ontologies": False, "reason": False, **options})
    assert isinstance(kb, KnowledgeBase)
    return kb


def _empty(server: SparqlServer) -> None:
    with rtask.open(server.address, plain=True) as bare:
        rows = bare.select("SELECT DISTINCT ?g { GRAPH ?g { ?s ?p ?o } }")
        ours = [str(g) for (g,) in rows if "openlink" not in str(g) and "//localuri" not in str(g)]
        for graph in ours:
            if "/ns/ldp#" not in graph:
                bare.update(f"DROP SILENT GRAPH {graph}")
        with contextlib.suppress(RtaskError):  # some servers have no default graph
            bare.update("DROP SILENT DEFAULT")


def remote_store(kb: KnowledgeBase) -> RemoteStore:
    if not isinstance(kb.store, RemoteStore):
        pytest.skip("only on servers")
    return kb.store


def texts(kb: KnowledgeBase, pattern: str) -> list[str]:
    return sorted(str(row[0]) for row in kb.select(f"SELECT ?x {{ {pattern} }}"))
