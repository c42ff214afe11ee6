"""Confidence from the evidence of print: one logistic function for each support by stored views.

Every weight has the sign that its meaning demands, so that more agreement never lowers the
confidence. The constants are shipped: ``fit_print.py`` in ``tests/benchmarks/recognition`` prints
them, and ``docs/recognition-measured.md`` says what they are worth on what was left out.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.evidence import PrintEvidence

__all__ = [
    "PRINT_TERMS",
    "PrintParams",
    "has_same_colours",
    "print_score",
    "print_terms",
    "within_requirements",
    "without_contradiction",
]

PRINT_TERMS: dict[str, int] = {
    "matches": 1, "extent": 1, "stable": 1, "stable_share": 1, "low_quartile": 1, "median": 1,
    "colour_contradiction": -1, "colour_gap": -1, "error": -1, "stable_lead": 1, "lead": 1,
    "supported": 1, "agreeing": 1, "blank": -1, "other_colour": -1, "correlation": 1, "seen": 1,
    "difference": -1, "look_lead": 1, "unlike": 1, "clear": 1,
}  # fmt: skip
"""Terms of the logistic function and the sign of the weight of each."""


def print_terms(e: PrintEvidence) -> NDArray[np.float64]:
    """Return the values of :data:`PRINT_TERMS` for one view.

    Examples
    --------
    >>> same = PrintEvidence(30, 0.5, 3.0, 0.7, 0.85, 0.0, 0.5, 25, 0.6)
    >>> len(print_terms(same)) == len(PRINT_TERMS)
    True
    """
    s = e.supported
    largest = 0.0 if e.difference is None else min(4 * e.difference.share, 1.5)
    largest *= s if e.verified else 1.0  # where nothing is supported, between the matches
    # The clearer the rest agrees, the more a region that does not agree says.
    largest *= float(np.clip(2 * (e.median - 0.4), 0.2, 1.0))
    return np.array(
        [
            np.log2(1 + min(e.matches, 63)), e.extent, min(np.log2(1 + e.stable), 5.0),
            e.stable_share, e.low_quartile, e.median, e.colour_contradiction, e.colour_gap,
            min(e.error, 20.0) / 4, e.stable_lead, e.lead,
            s, s * (e.agreeing - 0.5), s * e.blank, s * e.other_colour,
            s * (e.correlation - 0.4), s * (e.seen - 0.5), largest, e.look_lead,
            # Of a thing that was seen all round few stored views can agree with this stored one.
            np.log2(1 + min(e.unlike, 3)), _clear(e),
        ]
    )  # fmt: skip


def _clear(e: PrintEvidence) -> float:
    """Return 0 to 1: whether everything agrees at once, and with no other object as much.

    In a sum much of one thing makes up for little of another: many matches for a print between
    them that correlates poorly. A sibling has much of most things, and lacks one.
    """
    margins = (
        (np.log2(1 + e.matches) - 3.5) / 0.5,  # 10 matches to 15
        (e.extent - 0.2) / 0.08,
        (e.low_quartile - 0.4) / 0.25,
        (e.median - 0.7) / 0.15,
        (0.08 - e.colour_contradiction) / 0.05,
        (0.15 - e.supported * e.other_colour) / 0.1,
        e.lead,  # twice the matches of the next object
        (e.stable_lead + 0.05) / 0.1,
    )
    return float(np.clip(min(margins), 0.0, 1.0))


# Offset first, then the weights in the order of the terms.
_ONE_VIEW = (
    -6.16, 0.0, 13.3, 0.0, 0.0, 0.265, 1.91, -1.1,
    0.0, 0.0, 5.83, 0.593, 0.0, 0.0, 0.0, 0.0,
    0.0, 0.0, -8.0, 4.46, 0.0, 2.59,
)  # fmt: skip
_ROUND = (
    -0.0284, 0.0, 3.0, 0.0, 0.0701, 0.0, 0.0, -0.684,
    -0.0761, 0.0, 2.81, 0.612, 0.0, 0.0, 0.0, 0.0,
    0.0, 0.0, -8.0, 2.89, 0.0, 0.494,
)  # fmt: skip
_TWO = (
    -6.45, 0.603, 3.0, 0.0, 0.0, 0.214, 1.13, -2.58,
    -0.0916, 0.0, 4.32, 0.432, 1.59, 0.0, -0.432, 0.0,
    0.137, 3.78, -8.0, 0.987, 0.769, 1.16,
)  # fmt: skip
_FOUR = (
    -8.62, 0.00641, 4.96, 0.154, 0.0, 1.61, 1.58, -3.44,
    -0.461, -0.266, 3.48, 0.376, 3.95, 1.66, 0.0, 0.0,
    0.0, 5.23, -8.0, 0.0, 1.5, 1.63,
)  # fmt: skip


@dataclass(frozen=True)
class PrintParams:
    """Constants of the confidence of print.

    Parameters
    ----------
    weights
        Offset and weights of the terms for each :attr:`PrintEvidence.support`.
    min_extent, min_seen
        Where other views of the object show its print, the matches have to span so much of it, or
        the query to show so large a share of it: a sibling in view by the common part agrees there.
    max_contradiction, max_contradiction_alone
        Largest share of cells of another colour between the matches, and that for an object with
        one view, of which no other view says what may vary.
    few_matches, min_median
        Fewer matches than that, and those with the only view of an object, count only if the print
        between them correlates so far.
    wide_matches, wide_extent, wide_low_quartile, wide_median
        Print that agrees in so many matches, over so much of the object, and correlates so well
        there, shows how the query's camera renders colours. Only what is left counts as another
        colour then: a sibling's other colour is left.
    max_rendered_alone
        Largest share of it for an object with one view.
    part_extent, part_median, part_doubt
        Under a mask that was given, print that spans less than ``min_extent`` but more than this,
        and correlates so far, may decide, with so much taken off its odds.
    """

    weights: tuple[tuple[float, ...], ...] = field(default=(_ONE_VIEW, _ROUND, _TWO, _FOUR))
    min_extent: float = 0.24
    min_seen: float = 0.65
    max_contradiction: float = 0.15
    max_contradiction_alone: float = 0.06
    few_matches: int = 12
    min_median: float = 0.5
    wide_matches: int = 20
    wide_extent: float = 0.25
    wide_low_quartile: float = 0.4
    wide_median: float = 0.7
    max_rendered_alone: float = 0.08
    part_extent: float = 0.16
    part_median: float = 0.8
    part_doubt: float = 0.5


def print_score(
    e: PrintEvidence, params: PrintParams | None = None, *, is_mask_guessed: bool = False
) -> float:
    """Return the logarithmic odds that the print of the query is that of the view's object.

    They are at most even where too little of the print agrees, or what agrees has another colour.
    """
    params = params or PrintParams()
    if not is_mask_guessed:
        e = _in_frame(e)
    offset, *slopes = params.weights[e.support]
    odds = float(offset + np.dot(slopes, print_terms(e)))
    return within_requirements(odds, e, params, is_mask_guessed)


def _in_frame(e: PrintEvidence) -> PrintEvidence:
    """Return the evidence with its extent on the only stored view, if the query shows all of it.

    Of an object with several views the others say what the surroundings are.
    """
    return replace(e, extent=max(e.extent, e.framed_extent)) if e.support == 0 else e


def within_requirements(
    odds: float, e: PrintEvidence, params: PrintParams, is_mask_guessed: bool = False
) -> float:
    """Return the odds, at most even unless all that print must show to decide is there."""
    if is_mask_guessed:
        # Measured under given masks alone: a cut may hold what stands behind the object.
        e = replace(e, rendered_contradiction=1.0)
    if not _can_decide(e, params):
        return min(odds, 0.0)
    if e.verified == 0 or e.extent >= params.min_extent or e.seen >= params.min_seen:
        return odds
    # Siblings share a part: of what is seen of one, more has to agree.
    may_decide = e.extent > params.part_extent and e.median >= params.part_median
    if is_mask_guessed or not may_decide:
        return min(odds, 0.0)
    return min(odds, max(odds - params.part_doubt, 0.0))


def _can_decide(e: PrintEvidence, params: PrintParams) -> bool:
    """Tell whether the print agrees well enough, and in its colours, for print to decide."""
    is_alone = e.support == 0
    has_few = is_alone or e.matches < params.few_matches
    is_weak = has_few and e.median < params.min_median
    most = params.max_contradiction_alone if is_alone else params.max_contradiction
    most_rendered = params.max_rendered_alone if is_alone else params.max_contradiction
    has_colours = e.colour_contradiction <= most
    if not has_colours and _agrees_widely(e, params):
        has_colours = e.rendered_contradiction <= most_rendered
    return has_colours and not is_weak


def _agrees_widely(e: PrintEvidence, params: PrintParams) -> bool:
    """Tell whether the print agrees over so much that it shows how colours are rendered."""
    return (
        e.matches >= params.wide_matches
        and e.extent >= params.wide_extent
        and e.low_quartile >= params.wide_low_quartile
        and e.median >= params.wide_median
    )


def has_same_colours(e: PrintEvidence, params: PrintParams | None = None) -> bool:
    """Tell whether print agrees widely and in its colours, in whatever light the whole appears.

    Examples
    --------
    >>> seen = PrintEvidence(90, 0.5, 3.0, 0.7, 0.85, 0.2, 1.6, 80, 0.6)
    >>> has_same_colours(seen), has_same_colours(replace(seen, rendered_contradiction=0.01))
    (False, True)
    """
    params, e = params or PrintParams(), _in_frame(e)
    is_alike = min(e.colour_contradiction, e.rendered_contradiction) <= params.max_rendered_alone
    return is_alike and _agrees_widely(e, params)


def without_contradiction(e: PrintEvidence) -> PrintEvidence:
    """Return the evidence as if nothing contradicted: what a member of the family would show."""
    return replace(
        e,
        low_quartile=max(e.low_quartile, 0.7),
        median=max(e.median, 0.85),
        colour_contradiction=0.0,
        rendered_contradiction=0.0,
        colour_gap=min(e.colour_gap, 0.6),
        agreeing=1.0,
        blank=0.0,
        other_colour=0.0,
        correlation=max(e.correlation, 0.8),
        difference=None,
    )
