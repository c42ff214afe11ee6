"""One print on two objects, which sight therefore cannot tell apart.

Some products are sold under two names in one package, and some are stored twice. A look-alike
differs from the object somewhere; here nothing does, wherever both views show the object.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from features.recognition.comparison.difference import Comparison
from features.recognition.comparison.evidence import PrintEvidence

__all__ = ["MIN_SAME_PRINT", "is_same_print"]

MIN_SAME_PRINT = 15
"""Matches from which a print may be called the same: an emblem gives fewer."""
_MIN_AGREEING, _MAX_OTHER_COLOUR = 0.9, 0.05
_SAME, _OTHER = 15.0, 18.0
"""Lab units: cells of one colour differ by less, and more is another colour."""
_CORRELATION = 0.45


def is_same_print(evidence: PrintEvidence, comparison: Comparison) -> bool:
    """Tell whether two views show the same print.

    At least 0.9 of the cells must agree and fewer than 0.05 be of another colour, between the
    matches and in all that both views show of the object. Where the stored view's object has other
    views, that is where those support it; else all that lies under both masks.

    Parameters
    ----------
    evidence
        Of the comparison, with what is known of the stored view.
    comparison
        Of the two views.
    """
    if evidence.matches < MIN_SAME_PRINT or not _agrees(comparison, comparison.between):
        return False
    if evidence.supported == 0:
        return _agrees(comparison, comparison.near)
    return evidence.agreeing > _MIN_AGREEING and evidence.other_colour < _MAX_OTHER_COLOUR


def _agrees(comparison: Comparison, cells: NDArray[np.bool_]) -> bool:
    if not cells.any():
        return False
    gap = comparison.colour_gap[cells]
    blank = ~comparison.textured[cells]
    same = ((comparison.correlation[cells] > _CORRELATION) | blank) & (gap < _SAME)
    return bool(same.mean() > _MIN_AGREEING and (gap > _OTHER).mean() < _MAX_OTHER_COLOUR)
