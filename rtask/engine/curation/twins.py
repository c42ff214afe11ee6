"""Twins: objects of the graph whose stored views are recognised as each other's.

A product that was met twice without being recognised is stored as two objects, and is then told
apart by nothing: its views are as much like the one as like the other, so that recognition answers
"multiple". Where an insertion noted which object the new one resembles (``rt:similarTo``), it is
enough that a view of one of them is recognised as the other.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rtask.engine.stored import StoredView, stored_views
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from features.recognition.index.recognition_index import RecognitionIndex
    from features.recognition.recogniser import Recogniser
    from features.recognition.views.view import ViewFeatures
    from rtask.kb.core import GraphCore

__all__ = ["Twins", "count_untried", "find_twins", "merges_of"]

_Described = tuple[StoredView, "ViewFeatures"]


@dataclass(frozen=True)
class Twins:
    """Two objects that seem to be one.

    Parameters
    ----------
    first, second
        IRIs, the earlier one first.
    confidence
        The lower of the best ones with which views of either were recognised as the other.
    """

    first: str
    second: str
    confidence: float


def find_twins(kb: GraphCore, views_each: int = 4) -> list[Twins]:
    """Return the pairs of objects of which each is recognised as the other, surest first.

    Of two that are said to be alike, one is enough.

    Each object is left out of an index of its own for this, and some of its views are recognised
    against all others.

    Parameters
    ----------
    kb
        The graph; nothing changes.
    views_each
        How many views of each object are tried, oldest first.
    """
    from features.recognition.index.recognition_index import RecognitionIndex
    from features.recognition.recogniser import Recogniser

    index = RecognitionIndex()
    objects: dict[str, list[_Described]] = {}
    for view in stored_views(kb):
        features = view.features(kb)
        if features is not None:
            index.add(view.view, view.object, view.class_iri, features)
            objects.setdefault(view.object, []).append((view, features))
    recogniser = Recogniser(index)
    taken_for = {
        object_iri: _recognised_without(index, recogniser, views, views_each)
        for object_iri, views in objects.items()
    }
    return _mutual(taken_for, _alike(kb))


def count_untried(kb: GraphCore, views_each: int) -> int:
    """Return how many views are beyond those that :func:`find_twins` tries.

    While there are any, that no pair was recognised is not decided: a later view may show it.
    """
    counts = Counter(view.object for view in stored_views(kb))
    return sum(max(count - views_each, 0) for count in counts.values())


def _alike(kb: GraphCore) -> set[tuple[str, str]]:
    """Return the pairs that were alike when the first was inserted, both ways."""
    pairs = {
        (quad.subject.value, quad.object.value)
        for quad in kb.match(None, RT.similarTo)
        if isinstance(quad.subject, NamedNode) and isinstance(quad.object, NamedNode)
    }
    return pairs | {(other, first) for first, other in pairs}


def _recognised_without(
    index: RecognitionIndex,
    recogniser: Recogniser,
    views: Sequence[_Described],
    views_each: int,
) -> dict[str, float]:
    """Return the objects as which an object's views are recognised, with the best confidence."""
    for view, _ in views:
        index.remove(view.view)
    confidences: dict[str, float] = {}
    for _, features in views[:views_each]:
        answer = recogniser.recognise(features, max_results=1)
        if answer.accepted:
            match = answer.matches[0]
            confidences[match.object_iri] = max(
                match.confidence, confidences.get(match.object_iri, 0.0)
            )
    for view, features in views:
        index.add(view.view, view.object, view.class_iri, features)
    return confidences


def _mutual(
    taken_for: Mapping[str, Mapping[str, float]], alike: Collection[tuple[str, str]] = ()
) -> list[Twins]:
    """Return the pairs in which each was taken for the other, or one of two that are alike was.

    >>> taken = {"a": {"b": 0.9}, "b": {"a": 0.8}, "c": {"a": 0.7}}
    >>> _mutual(taken)
    [Twins(first='a', second='b', confidence=0.8)]
    >>> _mutual(taken, {("a", "c"), ("c", "a")})[1]
    Twins(first='a', second='c', confidence=0.7)
    """
    order = {object_iri: k for k, object_iri in enumerate(taken_for)}
    pairs = []
    for viewed, others in taken_for.items():
        for other, sure in others.items():
            back = taken_for[other].get(viewed)
            if back is None and (viewed, other) in alike:
                first, second = sorted((viewed, other), key=order.__getitem__)
                pairs.append(Twins(first, second, sure))
            elif back is not None and order[viewed] < order[other]:
                pairs.append(Twins(viewed, other, min(sure, back)))
    return sorted(pairs, key=lambda pair: -pair.confidence)


def merges_of(pairs: Sequence[Twins]) -> list[tuple[str, str]]:
    """Return which object to merge into which, so that each ends in the first of its group.

    >>> merges_of([Twins("a", "b", 0.9), Twins("b", "c", 0.8), Twins("a", "c", 0.7)])
    [('b', 'a'), ('c', 'a')]
    """
    into: dict[str, str] = {}

    def survivor(object_iri: str) -> str:
        while object_iri in into:
            object_iri = into[object_iri]
        return object_iri

    merges = []
    for pair in pairs:
        first, second = survivor(pair.first), survivor(pair.second)
        if first != second:
            into[second] = first
            merges.append((second, first))
    return merges
