"""The bundled ontology: load it into new stores and upgrade it in old ones."""

from __future__ import annotations

import logging
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from pyoxigraph import NamedNode, Quad, parse

import ontology
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.reverting import BUNDLED
from rtask.kb.store.collector import collector_paused
from rtask.rdf.terms import RDF_TYPE, GraphName, python_value, stored_quad

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["refresh"]

_log = logging.getLogger(__name__)
_OWL = "http://www.w3.org/2002/07/owl#"
_ONTOLOGY = NamedNode(_OWL + "Ontology")
_VERSION = NamedNode(_OWL + "versionInfo")


def refresh(kb: GraphCore) -> Commit | None:
    """Load the bundled modules that are missing from the knowledge base or outdated in it.

    One commit loads them all, so that no reader sees part of an ontology. Modules of which the
    knowledge base has a newer version are left unchanged.
    """
    stale = [path for path in ontology.modules() if _is_stale(kb, path)]
    if not stale:
        return None
    kinds: dict[GraphName, str] = {}
    request = Request(kb.access(), note=BUNDLED, kinds=kinds, trusted=True)
    with collector_paused(), kb.commit_block(request) as tx:
        for path in stale:
            name, quads = _module(path, path.stat().st_mtime_ns)
            kinds[name] = "OntologyGraph"
            tx.clear(name)
            tx.add_quads(quads, as_read=True)
    _log.info("loaded %d modules of the bundled ontology", len(stale))
    return tx.commit


@lru_cache(maxsize=64)
def _module(path: Path, changed_ns: int) -> tuple[NamedNode, tuple[Quad, ...]]:
    """Return the name of a module's graph and its statements there as the store keeps them.

    They are kept: a process that opens one knowledge base after another parses each file once.
    """
    quads = list(parse(path=path, rename_blank_nodes=True))
    name = _name(quads, path)
    named = (Quad(quad.subject, quad.predicate, quad.object, name) for quad in quads)
    return name, tuple(map(stored_quad, named))


def _name(quads: list[Quad], path: Path) -> NamedNode:
    for quad in quads:
        if quad.predicate == RDF_TYPE and quad.object == _ONTOLOGY:
            assert isinstance(quad.subject, NamedNode)
            return quad.subject
    raise AssertionError(f"{path} declares no ontology")


def _is_stale(kb: GraphCore, path: Path) -> bool:
    name: NamedNode | None = None
    for quad in parse(path=path):
        if quad.predicate == RDF_TYPE and quad.object == _ONTOLOGY:
            assert isinstance(quad.subject, NamedNode)
            name = quad.subject
        elif quad.predicate == _VERSION and quad.subject == name:
            return _stored_version(kb, name) < _numbers(str(python_value(quad.object)))
    return name is None or _stored_version(kb, name) == ()


def _stored_version(kb: GraphCore, name: NamedNode) -> tuple[int, ...]:
    quads = kb.match(name, _VERSION, None, name)
    return _numbers(str(python_value(quads[0].object))) if quads else ()


def _numbers(version: str) -> tuple[int, ...]:
    """Return a version as numbers.

    >>> _numbers("1.10.0") > _numbers("1.9.2")
    True
    """
    return tuple(int(part) for part in version.split("-")[0].split(".") if part.isdigit())
