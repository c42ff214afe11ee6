"""Terms that ontologies declare: what they mean is nobody's to say but their ontology's.

`rt:mass a cora:Robot` is no axiom by its vocabulary, and yet it has everybody meet a robot where a
property is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from pyoxigraph import NamedNode

import ontology
from rtask.kb.store.graph_store import GraphStore
from rtask.rdf.terms import RDF_TYPE

__all__ = ["declared_terms"]

_KINDS = frozenset(
    ontology.PREFIXES[prefix] + name
    for prefix, names in (
        ("owl", (
            "Class", "ObjectProperty", "DatatypeProperty", "AnnotationProperty", "Ontology",
            "OntologyProperty", "FunctionalProperty", "InverseFunctionalProperty",
            "TransitiveProperty", "SymmetricProperty", "AsymmetricProperty", "ReflexiveProperty",
            "IrreflexiveProperty", "DeprecatedClass", "DeprecatedProperty",
        )),
        ("rdfs", ("Class", "Datatype")),
        ("rdf", ("Property",)),
    )
    for name in names
)  # fmt: skip
_SHIPPED = (
    ontology.ONTOLOGY,
    *(ontology.PREFIXES[p].rstrip("#") for p in ("cora", "corax", "rparts", "pos", "sumo")),
)


def declared_terms(store: GraphStore, ontologies: Iterable[NamedNode]) -> Iterator[NamedNode]:
    """Yield the terms that ontologies declare.

    Those are classes, properties, datatypes and the ontologies themselves. Individuals are among
    them only where the shipped ontology has them (its colours, its reasons): the ontology of a
    laboratory may hold its rooms, about which robots report.
    """
    for graph in ontologies:
        is_shipped = graph.value in _SHIPPED or graph.value.startswith(f"{ontology.ONTOLOGY}/")
        for quad in store.quads_for_pattern(None, RDF_TYPE, None, graph):
            if isinstance(quad.subject, NamedNode) and (
                is_shipped or getattr(quad.object, "value", "") in _KINDS
            ):
                yield quad.subject
