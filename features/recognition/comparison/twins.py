"""Stored views that show the print of another object, and objects that carry one print."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from features.recognition.comparison.difference import compare_pictures
from features.recognition.comparison.evidence import ViewFacts, print_evidence
from features.recognition.comparison.kept import Kept
from features.recognition.comparison.same_print import (
    MIN_SAME_PRINT,
    Agreement,
    agreement_of,
    agrees_between,
    contradicted,
    is_same_print,
)
from features.recognition.comparison.store_facts import StoreFacts
from features.recognition.index.snapshot import Snapshot

__all__ = ["Twins"]

_MAX_VIEWS = 8
"""Views of each of two objects of which all pairs are compared."""
_MAX_CACHED = 4_000


@dataclass(frozen=True, eq=False)
class _Compared:
    """Agreement of two views, None where it was not worked out.

    Parameters
    ----------
    facts
        Of the second view, that the agreement follows from.
    is_final
        They match in too few places to be the same print.
    """

    agreement: Agreement | None = None
    facts: ViewFacts | None = None
    is_final: bool = False


class Twins:
    """Agreement of stored views with those of other objects, as of now; safe to share.

    Parameters
    ----------
    facts
        Of the stored views: what supports a view decides where it is compared.
    """

    def __init__(self, facts: StoreFacts) -> None:
        self._facts = facts
        self._kept: Kept[tuple[int, int], _Compared] = Kept(_MAX_CACHED)

    def of_view(self, snapshot: Snapshot, view: int) -> list[int]:
        """Return the objects that cannot be told from a view's object where the view shows it."""
        return [
            int(snapshot.object_of_view[other])
            for other in self._same(snapshot, view)
            if is_same_print(
                [self._contradicted(snapshot, view, self._with_siblings(snapshot, other))]
            )
        ]

    def of_object(self, snapshot: Snapshot, view: int) -> list[int]:
        """Return the objects that carry the print of a view's object, by all pairs of views.

        Of either object those views are taken that look most like the two that show it.
        """
        return [
            int(snapshot.object_of_view[other])
            for other in self._same(snapshot, view)
            if is_same_print(
                self._contradicted(snapshot, here, self._with_siblings(snapshot, other))
                for here in self._with_siblings(snapshot, view)
            )
        ]

    def _same(self, snapshot: Snapshot, view: int) -> list[int]:
        """Return a view of each other object that shows nothing but the print of a view."""
        if self._facts.picture(snapshot, view) is None:
            return []
        same: dict[int, int] = {}
        different, newly_different = self._facts.different(snapshot, view), list[int]()
        for other in self._facts.neighbours(snapshot, view).others:
            number = int(snapshot.object_of_view[other])
            if number in same or other in different:
                continue
            pair = self._compared(snapshot, view, other, is_asked=False).agreement
            if pair is None:
                newly_different.append(other)
            elif pair.is_same:
                same[number] = other
        self._facts.note_different(snapshot, view, newly_different)
        return list(same.values())

    def _with_siblings(self, snapshot: Snapshot, view: int) -> list[int]:
        return [view, *self._facts.siblings(snapshot, view)][:_MAX_VIEWS]

    def _contradicted(self, snapshot: Snapshot, view: int, others: list[int]) -> tuple[int, int]:
        if self._facts.picture(snapshot, view) is None:
            return 0, 0
        pairs = [self._agreement(snapshot, view, other) for other in others]
        matching = [pair for pair in pairs if pair is not None]
        if not matching:
            return 0, 0
        return contradicted(self._facts.supported(snapshot, view).believed, matching)

    def _agreement(self, snapshot: Snapshot, view: int, other: int) -> Agreement | None:
        """Return how far two views agree, None where they match in too few places."""
        return self._compared(snapshot, view, other, is_asked=True).agreement

    def _compared(self, snapshot: Snapshot, view: int, other: int, is_asked: bool) -> _Compared:
        """Return what is kept of two views, or compare them.

        Parameters
        ----------
        is_asked
            For the agreement of views too that differ between their matches; without that, there
            is none, and nothing that is known of the second view is asked for.
        """
        key = _key(snapshot, view, other)
        held = self._kept.get(key)
        if held is not None and held.agreement is not None:
            support = self._facts.supported(snapshot, other)
            if _is_support_equal(held.facts, support):
                return held
        elif held is not None and (held.is_final or not is_asked):
            return held
        return self._kept.put(key, self._drawn(snapshot, view, other, is_asked))

    def _drawn(self, snapshot: Snapshot, view: int, other: int, is_asked: bool) -> _Compared:
        first, second = snapshot.stored_view(view), snapshot.stored_view(other)
        here, there = (self._facts.picture(snapshot, side) for side in (view, other))
        alignment = self._facts.aligned(snapshot, view, other) if here and there else None
        if here is None or there is None or alignment is None or len(alignment) < MIN_SAME_PRINT:
            return _Compared(is_final=True)
        places = first.keypoints[alignment.query_rows, :2]
        comparison = compare_pictures(here, there, alignment.query_from_view, places)
        if not is_asked and not agrees_between(comparison):
            return _Compared()
        height, width = here.mask.shape
        mask_px = np.array([0, 0, width, height], np.float32)
        facts = self._facts.supported(snapshot, other)
        evidence = print_evidence(alignment, comparison, second.keypoints, mask_px, facts)
        return _Compared(agreement_of(evidence, comparison, facts), facts)


def _key(snapshot: Snapshot, view: int, other: int) -> tuple[int, int]:
    return int(snapshot.serials[view]), int(snapshot.serials[other])


def _is_support_equal(first: ViewFacts | None, second: ViewFacts) -> bool:
    """Tell whether the same follows from both for :func:`agreement_of`."""
    if first is second:
        return True
    return (
        first is not None
        and first.verified == second.verified
        and np.array_equal(first.support, second.support)
    )
