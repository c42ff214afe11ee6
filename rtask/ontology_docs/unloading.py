"""Unloading of an ontology, with what follows from it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pyoxigraph import NamedNode

import ontology
from rtask.errors import ConflictError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Commit
from rtask.kb.core import GraphCore
from rtask.ontology_docs.source import prefixed
from rtask.ontology_docs.usage import (
    own_terms,
    refuse_bundled,
    require_loaded,
    stored_module,
    uses,
)
from rtask.rdf.terms import iri

__all__ = ["Unloaded", "unload"]

_IMPORTS = iri(ontology.PREFIXES["owl"] + "imports")


@dataclass(frozen=True)
class Unloaded:
    """Result of unloading an ontology.

    Parameters
    ----------
    ontology
        Its IRI.
    statements
        How many it had.
    used
        Numbers of statements of other graphs that use its terms, by term.
    importers
        Ontologies that import it.
    """

    ontology: str
    statements: int
    used: dict[str, int]
    importers: tuple[str, ...]
    commit: Commit | None = field(default=None, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as JSON-able values."""
        return {
            "ontology": self.ontology,
            "statements": self.statements,
            "used": self.used,
            "importers": list(self.importers),
            "commit": self.commit.seq if self.commit else None,
        }


def unload(
    kb: GraphCore,
    name: str,
    *,
    force: bool = False,
    dry_run: bool = False,
    access: Access | None = None,
) -> Unloaded:
    """Remove an ontology with what follows from it.

    Parameters
    ----------
    force
        Whether to remove it although other ontologies import it or data use its terms.

    Raises
    ------
    UnknownTermError
        It is not loaded.
    UsageError
        It comes with RTASK.
    ConflictError
        Other ontologies import it, or data use its terms.
    """
    graph = iri(name)
    require_loaded(kb, graph)
    refuse_bundled(graph)
    importers = sorted(
        quad.graph_name.value
        for quad in kb.match(None, _IMPORTS, graph)
        if isinstance(quad.graph_name, NamedNode)
        and quad.graph_name not in (graph, kb.graphs.inferred)
    )
    stored = stored_module(kb, graph)
    unloaded = Unloaded(
        name, len(stored.triples), uses(kb, own_terms(stored), graph), tuple(importers)
    )
    if dry_run:
        return unloaded
    if not force and (importers or unloaded.used):
        reasons = [f"<{importer}> imports it" for importer in importers[:3]]
        reasons += [f"{n} statements use {prefixed(t)}" for t, n in list(unloaded.used.items())[:3]]
        raise ConflictError(
            f"<{name}> is in use: {'; '.join(reasons)}; "
            "force=True (--force) unloads it all the same",
            importers=importers,
            used=unloaded.used,
        )
    commit = kb.update(f"DROP GRAPH {graph}", note=f"unload <{name}>", access=access or kb.access())
    return Unloaded(**{**vars(unloaded), "commit": commit})
