"""Terms that a newer version of an ontology replaces by others, from what the version says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import ontology
from rtask.ontology_docs.source import Module
from rtask.rdf.terms import NamedNode, Subject, TripleKey

__all__ = ["renames"]

_OWL, _DCTERMS = ontology.PREFIXES["owl"], ontology.PREFIXES["dcterms"]
_REPLACED_BY, _REPLACES = _DCTERMS + "isReplacedBy", _DCTERMS + "replaces"
_DEPRECATED = _OWL + "deprecated"
_EQUIVALENT = {_OWL + "equivalentClass", _OWL + "equivalentProperty", _OWL + "sameAs"}


def renames(new: Iterable[Module]) -> dict[str, str]:
    """Return the IRI of each replaced term with that of its replacement.

    A version says so by ``dcterms:isReplacedBy`` on the old term or ``dcterms:replaces`` on the new
    one, or by deprecating a term that it declares equivalent to another one. Replacements of
    replacements are followed. A term with two replacements is left out: which of them is meant is
    for people to say.
    """
    triples = [triple for module in new for triple in module.triples]
    deprecated = {s for s, p, o in triples if p.value == _DEPRECATED and _is_true(o)}
    renamed: dict[str, set[str]] = {}
    for old, other in _pairs(triples, deprecated):
        if old != other:
            renamed.setdefault(old.value, set()).add(other.value)
    direct = {old: next(iter(others)) for old, others in renamed.items() if len(others) == 1}
    return {old: end for old in direct if (end := _end(old, direct)) is not None}


def _pairs(
    triples: Iterable[TripleKey], deprecated: set[Subject]
) -> Iterator[tuple[NamedNode, NamedNode]]:
    for s, p, o in triples:
        if not isinstance(s, NamedNode) or not isinstance(o, NamedNode):
            continue
        if p.value == _REPLACED_BY:
            yield s, o
        elif p.value == _REPLACES:
            yield o, s
        elif p.value in _EQUIVALENT:
            if s in deprecated and o not in deprecated:
                yield s, o
            elif o in deprecated and s not in deprecated:
                yield o, s


def _end(start: str, direct: dict[str, str]) -> str | None:
    """Return the last replacement of a term; ``None`` if they run in a circle."""
    seen, here = {start}, direct[start]
    while here in direct:
        if here in seen:
            return None
        seen.add(here)
        here = direct[here]
    return here


def _is_true(value: object) -> bool:
    return getattr(value, "value", "") in ("true", "1")
