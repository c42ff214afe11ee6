"""What a pattern demands, in words."""

from __future__ import annotations

from rtask.asking.check.types import TYPE, Demand
from rtask.asking.check.vocabulary import Vocabulary, local

__all__ = ["articled", "demanded", "label_of"]


def demanded(vocabulary: Vocabulary, demand: Demand) -> str:
    """Return in words what an end must be, and why."""
    step = demand.edge.steps[0]
    if step.node.value == TYPE and demand.edge.object.kind == "iri":
        return f"it is said to be {articled(label_of(vocabulary, demand.edge.object.value))}"
    place = "subject" if (demand.at == 0) != step.is_inverse else "value"
    known = vocabulary.properties.get(step.node.value)
    kinds: list[str] = []
    if demand.is_observed and demand.bits:
        seen = vocabulary.most_specific(vocabulary.names(demand.bits))
        what = " or ".join(sorted(label_of(vocabulary, kind) for kind in seen)[:3])
        return f"a {place} of {local(step.node.value)} is {articled(what)} throughout this graph"
    if known is not None:
        kinds = known.classes[0 if place == "subject" else 1]
    if kinds:
        what = " or ".join(label_of(vocabulary, kind) for kind in kinds[:3])
    elif demand.is_thing is False:
        what = "literal"
    else:
        what = "thing"
    return f"a {place} of {local(step.node.value)} is {articled(what)}"


def articled(noun: str) -> str:
    """Return a noun with its article.

    >>> articled("outcome"), articled("box")
    ('an outcome', 'a box')
    """
    return f"{'an' if noun[:1].lower() in 'aeio' and noun else 'a'} {noun}"


def label_of(vocabulary: Vocabulary, iri: str) -> str:
    labels = sorted(vocabulary.labels.get(iri, ()), key=lambda label: (len(label), label))
    return labels[0] if labels else local(iri)
