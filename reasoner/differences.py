"""Changes of the inferred graph by a commit."""

from __future__ import annotations

from reasoner.facts.asserted import Asserted
from reasoner.facts.equality import Equality
from reasoner.facts.layer import Layer
from reasoner.reading import Reading
from reasoner.terms.dictionary import Fact
from reasoner.terms.vocabulary import SAME


def differences(before: Reading, after: Reading, changed: Asserted) -> tuple[set[Fact], set[Fact]]:
    """Return what enters and what leaves the inferred graph.

    Parameters
    ----------
    before, after : Reading
        The second is a layer over the facts of the first.
    changed : Asserted
        The staged changes of what is asserted.

    Returns
    -------
    added, removed : set of Fact
    """
    layer = after.facts
    assert isinstance(layer, Layer)
    touched = (*changed.added, *changed.removed)
    old = {*layer.removed, *map(before.equality.rewrite, touched)}
    new = {*layer.added, *map(after.equality.rewrite, touched)}
    merged = _changed_classes(before.equality, after.equality)
    for term in merged:
        old.update(before.facts.about(before.equality.find(term)))
        new.update(after.facts.about(after.equality.find(term)))
    ends = {x for s, p, o in touched if p == SAME for x in (s, o)}
    was = {*before.inferred(old), *before.equalities(merged | ends)}
    now = {*after.inferred(new), *after.equalities(merged | ends)}
    return now - was, was - now


def _changed_classes(before: Equality, after: Equality) -> set[int]:
    if before == after:
        return set()
    members = {m for e in (before, after) for _, ms in e.classes() for m in ms}
    return {m for m in members if before.members(m) != after.members(m)}
