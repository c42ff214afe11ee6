"""Constraints on values beyond their type.

Generated classes import this module, so it keeps its name.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import Decimal

__all__ = ["Limits"]


@dataclass(frozen=True)
class Limits:
    """Constraints on values, taken from SHACL shapes and closed lists.

    Parameters
    ----------
    least, most
        Inclusive bounds.
    above, below
        Exclusive bounds.
    pattern
        Regular expression that text must match.
    one_of
        IRIs of the individuals to choose from.
    """

    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None
    pattern: str | None = None
    one_of: tuple[str, ...] = ()

    def complaint(self, value: object) -> str | None:
        """Return what was expected, if the value violates a constraint.

        NaN and infinity are never what was measured, and pass no comparison with a bound.
        """
        if isinstance(value, float) and not math.isfinite(value):
            return "a finite number"
        if isinstance(value, int | float | Decimal) and not isinstance(value, bool):
            if self.least is not None and value < self.least:
                return f"{self.least} or more"
            if self.most is not None and value > self.most:
                return f"{self.most} or less"
            if self.above is not None and value <= self.above:
                return f"more than {self.above}"
            if self.below is not None and value >= self.below:
                return f"less than {self.below}"
        if self.pattern and isinstance(value, str) and not re.search(self.pattern, value):
            return f"text that matches {self.pattern}"
        return None
