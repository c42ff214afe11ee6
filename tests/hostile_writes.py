"""Hostile writes: much follows from few statements, or they change what the vocabulary means."""

from __future__ import annotations

import random
from collections.abc import Callable

PREFIXES = (
    "PREFIX rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> "
    "PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "
    "PREFIX owl: <http://www.w3.org/2002/07/owl#> "
)
_BUILT_IN = (
    *("rdf:type", "rdf:first", "rdf:rest", "rdf:nil", "rdfs:subClassOf", "rdfs:subPropertyOf"),
    *("rdfs:domain", "rdfs:range", "rdfs:Resource", "rdfs:Class", "owl:Thing", "owl:Nothing"),
    *("owl:sameAs", "owl:differentFrom", "owl:inverseOf", "owl:equivalentClass"),
    *("owl:equivalentProperty", "owl:disjointWith", "owl:onProperty", "owl:someValuesFrom"),
    *("owl:hasValue", "owl:TransitiveProperty", "owl:SymmetricProperty", "owl:Restriction"),
    *("owl:FunctionalProperty", "owl:InverseFunctionalProperty"),
)
_OWN = ("<urn:w:a>", "<urn:w:b>")


def _links(p: str, size: int) -> str:
    return " ".join(f"<urn:w:{i}> {p} <urn:w:{i + 1}> ." for i in range(size))


def _vocabulary(rng: random.Random, size: int) -> str:
    terms = (*_BUILT_IN, *_OWN)
    return " ".join(
        f"{rng.choice(terms)} {rng.choice(terms)} {rng.choice(terms)} ."
        for _ in range(rng.randint(1, 3))
    )


def _list(items: list[str]) -> str:
    """Return a list from ``<urn:w:n0>`` on, without blank nodes, so that it can be deleted."""
    rests = [*(f"<urn:w:n{i}>" for i in range(1, len(items))), "rdf:nil"]
    return " ".join(
        f"<urn:w:n{i}> rdf:first {item} ; rdf:rest {rest} ."
        for i, (item, rest) in enumerate(zip(items, rests, strict=True))
    )


def _names(size: int) -> list[str]:
    return [f"<urn:w:c{i}>" for i in range(size)]


KINDS: dict[str, Callable[[random.Random, int], str]] = {
    "vocabulary": _vocabulary,
    "symmetric subclasses": lambda rng, size: "rdfs:subClassOf a owl:SymmetricProperty .",
    "transitive chain": lambda rng, size: (
        f"<urn:w:t> a owl:TransitiveProperty . {_links('<urn:w:t>', size)}"
    ),
    "chain of sameAs": lambda rng, size: _links("owl:sameAs", size),
    "clique of sameAs": lambda rng, size: " ".join(
        f"<urn:w:{i}> owl:sameAs <urn:w:{j}> ." for i in range(round(size**0.5)) for j in range(i)
    ),
    "chain of classes": lambda rng, size: _links("rdfs:subClassOf", size),
    "hub": lambda rng, size: (
        "<urn:w:q> a owl:SymmetricProperty , owl:TransitiveProperty . "
        + " ".join(f"<urn:w:h> <urn:w:q> <urn:w:{i}> ." for i in range(size))
    ),
    "functional hub": lambda rng, size: (
        "<urn:w:f> a owl:FunctionalProperty . "
        + " ".join(f"<urn:w:h> <urn:w:f> <urn:w:{i}> ." for i in range(size))
    ),
    "property chain": lambda rng, size: (
        "<urn:w:g> owl:propertyChainAxiom <urn:w:n0> . "
        + _list(["<urn:w:g>", "<urn:w:g>"])
        + _links("<urn:w:g>", size)
    ),
    "key": lambda rng, size: (
        "<urn:w:K> owl:hasKey <urn:w:n0> . "
        + _list(["<urn:w:k>"])
        + " ".join(f"<urn:w:{i}> a <urn:w:K> ; <urn:w:k> 1 ." for i in range(size))
    ),
    "long list": lambda rng, size: (
        f"<urn:w:U> owl:{rng.choice(('unionOf', 'intersectionOf', 'oneOf'))} <urn:w:n0> . "
        + _list(_names(size))
    ),
    "all different": lambda rng, size: (
        f"<urn:w:D> a owl:AllDifferent ; owl:members <urn:w:n0> . {_list(_names(size))}"
    ),
}
"""Turtle statements of each kind, for a size."""


def hostile_write(kind: str, rng: random.Random, size: int) -> str:
    """Return an update of a kind, of about so many statements."""
    return f"{PREFIXES}INSERT DATA {{ {KINDS[kind](rng, size)} }}"
