"""Evidence of print: what the comparison of a query with one stored view says, in numbers.

Besides the comparison itself two things that the store knows of the view count: which of its
keypoints its object's other views confirm and which other objects carry too, and in which of its
cells the other views agree, so that the background of a photograph is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.alignment import Alignment
from features.recognition.comparison.difference import Comparison

__all__ = [
    "Difference",
    "PrintEvidence",
    "ViewFacts",
    "highest_preference",
    "preference",
    "print_evidence",
]

_SUPPORTED = 0.35
"""Share of the other views that have to agree in a cell for it to be believed."""
_FEW_CELLS, _FEW_SUPPORTED = 4, 3


@dataclass(frozen=True, eq=False)
class ViewFacts:
    """The evidence of the other stored views about one view.

    Parameters
    ----------
    own : (n,) int32
        In how many other views of the object each keypoint was verified.
    shared : (n,) int32
        In how many views of other objects.
    support : (cells,) float32
        How far the object's other views agree in each cell of the view's picture, 0 to 1.
    verified
        How many other views of the object agree with this one.
    unlike
        How many were compared and do not: they show other sides.
    """

    own: NDArray[np.int32]
    shared: NDArray[np.int32]
    support: NDArray[np.float32]
    verified: int
    unlike: int = 0

    @property
    def believed(self) -> NDArray[np.bool_]:
        """Return the cells (cells,) that the object's other views support; all where none can."""
        if self.verified == 0:
            return np.ones(len(self.support), bool)
        believed: NDArray[np.bool_] = self.support > _SUPPORTED
        return believed


@dataclass(frozen=True)
class Difference:
    """Largest connected region where the print of the query contradicts the stored view's.

    Parameters
    ----------
    box
        Left, top, width and height in the query's picture, as shares of its sides.
    share
        Of the cells in which it was looked for.
    """

    box: tuple[float, float, float, float]
    share: float

    @property
    def place(self) -> str:
        """Its position in words.

        >>> Difference((0.0, 0.7, 0.2, 0.3), 0.1).place
        'at the lower left'
        """
        left, top, width, height = self.box
        row = ("upper ", "", "lower ")[min(int(3 * (top + height / 2)), 2)]
        column = ("left", "middle", "right")[min(int(3 * (left + width / 2)), 2)]
        if row and column == "middle":
            return {"upper ": "at the top", "lower ": "at the bottom"}[row]
        return "in the middle" if column == "middle" else f"at the {row}{column}"


@dataclass(frozen=True)
class PrintEvidence:
    """Evidence of one stored view's print; the names follow the model of the confidence.

    Parameters
    ----------
    matches
        Keypoints that agree on one map.
    extent
        Square root of the area between them, of the object's longer side, at most 0.6.
    error
        Residual of the matches, thousandths of the longer side.
    low_quartile, median
        Of the correlation over the textured cells between the matches.
    colour_contradiction, colour_gap
        Share of cells of another colour, and the 90 % quantile of the colour distance.
    stable, stable_share
        Matches whose keypoints the object's other views confirm and no other object has: how
        many, and of those that the map brings into the picture.
    stable_lead, lead
        Stable share minus that of the candidate with most matches among the others, and the
        binary logarithm of the ratio of matches.
    supported
        0 to 1: whether the object's other views support enough cells for what follows.
    agreeing, blank, other_colour, correlation, seen
        Weighted by the support: share of cells that agree, share where print meets none, share of
        another colour, mean correlation, and how much of the supported print is seen.
    verified, unlike
        Other views of the object that agree with this one, and that show other sides.
    look_lead
        Similarity of colours and shapes to the object's most similar view, minus that to the next
        object's, -0.2 to 0.2.
    rendered_contradiction
        Share of cells of another colour after a camera's rendering of colours was taken out.
    framed_extent
        The extent on the stored view, where the query shows all of that and more; else 0.
    difference
        Where it differs most.
    """

    matches: int
    extent: float
    error: float
    low_quartile: float
    median: float
    colour_contradiction: float
    colour_gap: float
    stable: int
    stable_share: float
    stable_lead: float = 0.3
    lead: float = 2.0
    supported: float = 0.0
    agreeing: float = 0.5
    blank: float = 0.0
    other_colour: float = 0.0
    correlation: float = 0.4
    seen: float = 0.5
    verified: int = 0
    unlike: int = 0
    look_lead: float = 0.0
    rendered_contradiction: float = 1.0
    framed_extent: float = 0.0
    difference: Difference | None = field(default=None, compare=False)

    @property
    def support(self) -> int:
        """Number of the constants that apply, by the support of stored views.

        0 for an object with one view, 1 for a view that none of the others agrees with because they
        show other sides, 2 where two or three views agree, 3 where more do.
        """
        if self.verified == 0:
            return 1 if self.unlike else 0
        return 2 if self.verified < 3 else 3


def highest_preference(alignment: Alignment, comparison: Comparison) -> float:
    """Return the most that :func:`preference` can be, whatever the store knows."""
    _, median = _correlations(comparison)
    contradiction = _contradiction(comparison.colour_gap[comparison.between])
    return _preference(len(alignment), median, contradiction) + 1.0


def preference(
    alignment: Alignment,
    comparison: Comparison,
    keypoints: NDArray[np.float32],
    mask_px: NDArray[np.float32],
    facts: ViewFacts,
) -> float:
    """Return the order of the views of one object, of which the best stands for it.

    Of the facts, those of keypoints alone count; parameters as in :func:`print_evidence`.
    """
    _, median = _correlations(comparison)
    contradiction = _contradiction(comparison.colour_gap[comparison.between])
    _, share = _stable(alignment, keypoints, mask_px, facts)
    return _preference(len(alignment), median, contradiction) + share


def _preference(matches: int, median: float, contradiction: float) -> float:
    """Return the part of the preference that needs no facts of the stored view."""
    return float(np.log2(1 + matches) + 2 * median - 1.5 * contradiction)


def _correlations(comparison: Comparison) -> tuple[float, float]:
    """Return low quartile and median of the correlation between the matches."""
    chosen = comparison.between & comparison.textured
    if np.count_nonzero(chosen) < _FEW_CELLS:
        return 0.3, 0.4
    low, median = np.quantile(comparison.correlation[chosen], [0.25, 0.5]).tolist()
    return low, median


def _contradiction(gaps: NDArray[np.float32]) -> float:
    """Return the share of cells of another colour, of colour distances (n,)."""
    return float((gaps > 15).mean()) if len(gaps) else 0.0


def print_evidence(
    alignment: Alignment,
    comparison: Comparison,
    keypoints: NDArray[np.float32],
    mask_px: NDArray[np.float32],
    facts: ViewFacts,
) -> PrintEvidence:
    """Return the evidence of one view, as if no other object were stored.

    Parameters
    ----------
    keypoints : (n, 4) float32
        Of the stored view.
    mask_px : (4,) float32, px
        Left, top, width and height of the query's mask.
    facts
        Of the stored view.
    """
    low, median = _correlations(comparison)
    gaps = comparison.colour_gap[comparison.between]
    weight, here = _support(comparison, facts)
    count, stable_share = _stable(alignment, keypoints, mask_px, facts)
    return PrintEvidence(
        matches=len(alignment),
        extent=min(comparison.extent, 0.6),
        error=1000 * alignment.error,
        low_quartile=low,
        median=median,
        colour_contradiction=_contradiction(gaps),
        colour_gap=float(np.quantile(gaps, 0.9)) / 10 if len(gaps) else 0.0,
        stable=count,
        stable_share=stable_share,
        verified=facts.verified,
        unlike=facts.unlike,
        rendered_contradiction=_contradiction(comparison.rendered_gap[comparison.between]),
        framed_extent=min(comparison.framed_extent, 0.6),
        difference=_largest_difference(comparison, here > 0),
        **_supported(comparison, weight, here),
    )


def _stable(
    alignment: Alignment,
    keypoints: NDArray[np.float32],
    mask_px: NDArray[np.float32],
    facts: ViewFacts,
) -> tuple[int, float]:
    """Return how many matches are stable, and of what share of the stable keypoints in view."""
    confirmed = facts.own >= 1 if facts.verified else np.ones(len(facts.own), bool)
    stable = confirmed & (facts.shared == 0)
    count = int(np.count_nonzero(stable[alignment.view_rows]))
    shown = int(np.count_nonzero(stable & _is_shown(alignment, keypoints, mask_px)))
    return count, min(count / max(shown, 1), 1.0)


def _is_shown(
    alignment: Alignment, keypoints: NDArray[np.float32], mask_px: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """Return which keypoints of the view the map brings into the box of the query's mask."""
    matrix = alignment.query_from_view
    weight = keypoints[:, :2] @ matrix[2, :2] + matrix[2, 2]
    moved = (keypoints[:, :2] @ matrix[:2, :2].T + matrix[:2, 2]) / np.where(
        np.abs(weight) < 1e-9, 1e-9, weight
    )[:, None]
    inside = (moved >= mask_px[:2]) & (moved <= mask_px[:2] + mask_px[2:])
    shown: NDArray[np.bool_] = inside.all(axis=1) & (weight > 0)
    return shown


def _support(
    comparison: Comparison, facts: ViewFacts
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the support of the view's cells, and of those that the query shows.

    Both are nothing where the object's other views say too little.
    """
    weight = np.where(facts.support > _SUPPORTED, facts.support, np.float32(0))
    cells = comparison.view_cell
    here = np.where((cells >= 0) & comparison.near, weight[cells], np.float32(0))
    if facts.verified == 0 or weight.sum() < _FEW_SUPPORTED or here.sum() < _FEW_SUPPORTED:
        return np.zeros_like(weight), np.zeros_like(here)
    return weight, here


def _supported(
    comparison: Comparison, weight: NDArray[np.float32], here: NDArray[np.float32]
) -> dict[str, float]:
    """Return the part of the evidence that the object's other views support."""
    total = float(here.sum())
    if total == 0:
        return {}
    here = here / total
    correlation, gap = comparison.correlation, comparison.colour_gap
    blank = ~comparison.textured
    seen = np.unique(comparison.view_cell[here > 0])
    return {
        "supported": min(total / 20, 1.0),
        "agreeing": float(here[comparison.agrees].sum()),
        "blank": float(here[comparison.textured & (correlation < 0.2)].sum()),
        "other_colour": float(here[gap > 18].sum()),
        "correlation": float((here * np.where(blank, 0.5, correlation)).sum()),
        # A cell of the query may show more, or less, than one of the view.
        "seen": min(len(seen) / max(int(np.count_nonzero(weight)), 1), 1.0),
    }


def _largest_difference(comparison: Comparison, supported: NDArray[np.bool_]) -> Difference | None:
    """Return the largest connected contradiction after an opening of 2 x 2 cells.

    It is looked for where the object's other views agree; without such, between the matches: what
    lies beside them may be background.
    """
    compared = supported if supported.any() else comparison.between
    against = comparison.textured & (comparison.correlation < 0.2)
    if comparison.comparable_colours:  # a monochrome camera sees no other flavour everywhere
        against = against | (comparison.colour_gap > 18)
    against = compared & against
    kernel = np.ones((2, 2), np.uint8)
    opened = cv2.morphologyEx(against.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    count, _, stats, _ = cv2.connectedComponentsWithStats(np.asarray(opened, np.uint8))
    if count < 2:
        return None
    left, top, width, height, area = stats[1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())].tolist()
    rows, columns = compared.shape
    box = (left / columns, top / rows, width / columns, height / rows)
    return Difference(box, area / int(np.count_nonzero(compared)))
