"""Ontologies that a knowledge base has loaded, and the data that use their terms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from pyoxigraph import NamedNode, Quad

import ontology
from rtask.errors import UnknownTermError, UsageError, nearest
from rtask.kb.core import GraphCore
from rtask.ontology_docs.source import Module, bundled, module_of
from rtask.rdf.terms import iri

__all__ = [
    "data_graphs",
    "mentions",
    "own_terms",
    "refuse_bundled",
    "require_loaded",
    "stored_module",
    "uses",
]


def require_loaded(kb: GraphCore, name: NamedNode) -> None:
    """Raise unless an ontology is loaded.

    Raises
    ------
    UnknownTermError
        With the nearest one that is.
    """
    if not kb.catalogue.is_ontology(name):
        loaded = [graph.value for graph in kb.catalogue.ontologies()]
        raise UnknownTermError(f"the ontology {name} is not loaded{nearest(name.value, loaded)}")


def refuse_bundled(name: NamedNode) -> None:
    """Raise if an ontology comes with RTASK.

    Raises
    ------
    UsageError
        With what to do instead.
    """
    if name.value in {module.iri for module in bundled()[: len(ontology.modules())]}:
        raise UsageError(
            f"{name} comes with RTASK, which loads it and upgrades it when a folder is opened; "
            "open with ontologies=False to go without"
        )


def stored_module(kb: GraphCore, name: NamedNode) -> Module:
    """Return an ontology as it is loaded."""
    quads = kb.store.quads_for_pattern(None, None, None, name)
    return module_of(name.value, [(q.subject, q.predicate, q.object) for q in quads])


def own_terms(module: Module) -> set[str]:
    """Return what an ontology is about, in its own namespace."""
    start = module.iri.rstrip("#/")
    return {
        s.value
        for s, _, _ in module.triples
        if isinstance(s, NamedNode) and s.value.startswith(start) and s.value != module.iri
    }


def data_graphs(kb: GraphCore) -> list[NamedNode]:
    """Return the graphs of data: those that the reasoner reads and that hold no ontology."""
    return [
        graph
        for graph in kb.store.named_graphs()
        if isinstance(graph, NamedNode)
        and kb.graphs.is_input(graph)
        and not kb.catalogue.is_ontology(graph)
    ]


def mentions(kb: GraphCore, terms: Iterable[str], graph: NamedNode) -> Iterator[tuple[str, Quad]]:
    """Yield the statements of a graph that mention terms, once for each term and place."""
    find = kb.store.quads_for_pattern
    for term in terms:
        node = iri(term)
        for quads in (
            find(node, None, None, graph),
            find(None, node, None, graph),
            find(None, None, node, graph),
        ):
            for quad in quads:
                yield term, quad


def uses(kb: GraphCore, terms: set[str], but: NamedNode) -> dict[str, int]:
    """Return how many statements of data use each term."""
    counts: Counter[str] = Counter()
    for graph in data_graphs(kb):
        if graph != but:
            counts.update(term for term, _ in mentions(kb, terms, graph))
    return dict(sorted(counts.items()))
