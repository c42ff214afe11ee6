"""One print on two objects, which sight therefore cannot tell apart.

Some products are sold under two names in one package, and some are stored twice. A look-alike
differs from the object somewhere; here nothing does, wherever both show it. A pair of views may
show only what two siblings share, so that of two objects all pairs have a say, place by place.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.recognition.comparison.difference import Comparison
from features.recognition.comparison.evidence import PrintEvidence, ViewFacts

__all__ = [
    "MIN_SAME_PRINT",
    "Agreement",
    "agreement_of",
    "agrees_between",
    "contradicted",
    "is_same_print",
]

Mask = NDArray[np.bool_]

MIN_SAME_PRINT = 15
"""Matches from which a print may be called the same: an emblem gives fewer."""
_MIN_AGREEING, _MAX_OTHER_COLOUR = 0.9, 0.05
_MIN_SHOWN = 0.2
"""Of the supported print, or of the object's side between the matches, that both views show."""
_OTHER = 18.0
"""Lab units: cells that differ by more have another colour."""
_UNLIKE = 0.2
"""Print that correlates by less is another."""
_MAX_CONTRADICTED, _MAX_OF_SINGLE_VIEW = 0.09, 0.25
"""Share of the cells of all views, and of any one view, that the other object contradicts."""
_MIN_CELLS = 100
"""One view with fewer cells to compare has no say of its own."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """Agreement of a view with a view of another object, seen in the first one's frame.

    Parameters
    ----------
    is_same
        Nothing that both views show, which is a good part of the object, tells them apart.
    shown, against : (bytes,) uint8
        Cells of the first view's picture that both show, and those where the print or the colour
        is clearly another one; one bit each.
    """

    is_same: bool
    shown: UInt8Array
    against: UInt8Array


def agreement_of(evidence: PrintEvidence, comparison: Comparison, facts: ViewFacts) -> Agreement:
    """Return how far two views that match in at least :data:`MIN_SAME_PRINT` places agree.

    They show the same print where more than 0.9 of the cells agree and fewer than 0.05 are of
    another colour, between the matches and in all that both show of the object. Where the stored
    view's object has other views, that is where those support it; else all that lies under both
    masks.

    Parameters
    ----------
    evidence
        Of the comparison, with what is known of the stored view.
    comparison
        Of the two views.
    facts
        Of the stored view.
    """
    shown, agrees = evidence.extent, _agrees(comparison, comparison.near)
    if evidence.supported > 0:
        shown = evidence.seen
        agrees = evidence.agreeing > _MIN_AGREEING and evidence.other_colour < _MAX_OTHER_COLOUR
    cells = comparison.near & (comparison.view_cell >= 0)
    cells &= facts.believed[comparison.view_cell]
    against = comparison.textured & (comparison.correlation < _UNLIKE)
    against |= comparison.colour_gap > _OTHER
    return Agreement(
        shown >= _MIN_SHOWN and agrees and agrees_between(comparison),
        np.packbits(cells),
        np.packbits(cells & against),
    )


def agrees_between(comparison: Comparison) -> bool:
    """Tell whether two views agree between their matches; without that, they are not the same.

    This needs nothing that is known of the stored view.
    """
    return _agrees(comparison, comparison.between)


def contradicted(believed: Mask, pairs: Sequence[Agreement]) -> tuple[int, int]:
    """Return how many cells of a view another object contradicts, and of how many it shows.

    A cell is contradicted where most of the views that show it say so: light, a bent side or a
    hand spoil now this place and now that.

    Parameters
    ----------
    believed : (cells,) bool
        Cells of the view that count.
    pairs
        Agreement of the view with views of the other object.

    Examples
    --------
    >>> every, left = np.packbits(np.ones(8, bool)), np.packbits(np.arange(8) < 4)
    >>> pairs = [Agreement(False, every, left), Agreement(True, left, left & 0)]
    >>> contradicted(np.ones(8, bool), [pairs[0]]), contradicted(np.ones(8, bool), pairs)
    ((4, 8), (0, 8))
    """
    shown, against = (
        np.sum([np.unpackbits(cells, count=len(believed)) for cells in sort], axis=0)
        for sort in zip(*((pair.shown, pair.against) for pair in pairs), strict=True)
    )
    compared = believed & (shown > 0)
    return int((compared & (2 * against > shown)).sum()), int(compared.sum())


def is_same_print(views: Iterable[tuple[int, int]]) -> bool:
    """Tell whether two objects carry one print, by what :func:`contradicted` says of their views.

    Examples
    --------
    >>> is_same_print([(6, 200), (20, 150)]), is_same_print([(6, 900), (60, 200)])
    (True, False)
    """
    counts = [(against, of) for against, of in views if of]
    if any(against > _MAX_OF_SINGLE_VIEW * of for against, of in counts if of >= _MIN_CELLS):
        return False
    against, of = (sum(column) for column in zip(*counts, strict=True)) if counts else (0, 0)
    return of > 0 and against <= _MAX_CONTRADICTED * of


def _agrees(comparison: Comparison, cells: Mask) -> bool:
    if not cells.any():
        return False
    is_other_colour = comparison.colour_gap[cells] > _OTHER
    return bool(
        comparison.agrees[cells].mean() > _MIN_AGREEING
        and is_other_colour.mean() < _MAX_OTHER_COLOUR
    )
