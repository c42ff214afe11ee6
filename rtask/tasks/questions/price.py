"""Whether to ask a person: the price of asking against the price of failing (Kehoe 2014, 6.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rtask.errors import UsageError

__all__ = ["Help", "Prices", "Worth", "weigh"]

_PRIOR_HELPED, _PRIOR_ASKED = 1.0, 2.0
"""Before anybody was asked, half of all questions are expected to help; this weighs as two."""


@dataclass(frozen=True)
class Prices:
    """What a question and a failure cost, in any one unit, such as seconds of work or cents.

    Parameters
    ----------
    asking
        Of a question to a person, answered or not.
    failing
        Of a step that fails.

    Raises
    ------
    UsageError
        A price is negative, or no number.
    """

    asking: float
    failing: float

    def __post_init__(self) -> None:
        for name in ("asking", "failing"):
            price = getattr(self, name)
            if not (math.isfinite(price) and price >= 0):
                raise UsageError(f"the price of {name} is 0 or more, not {price}")


@dataclass(frozen=True)
class Help:
    """How often questions helped: answered in time, with a choice that lets the step succeed."""

    helped: int = 0
    ended: int = 0

    @property
    def chance(self) -> float:
        """Chance that the next one helps.

        >>> Help().chance, Help(8, 8).chance
        (0.5, 0.9)
        """
        return (self.helped + _PRIOR_HELPED) / (self.ended + _PRIOR_ASKED)


@dataclass(frozen=True)
class Worth:
    """Whether a question is worth its price.

    Parameters
    ----------
    asks
        Whether it is.
    gain
        What it is expected to save, in the unit of the prices.
    text
        Why, in words.
    """

    asks: bool
    gain: float
    text: str


def weigh(prices: Prices, chance: float, past: Help, retries: int = 0) -> Worth:
    """Return whether to ask about a step that succeeds with a chance if nobody is asked.

    An answer that helps saves the failures that would have come, the ones of each new try included;
    one that does not saves nothing.

    Parameters
    ----------
    chance
        Of one try, in [0, 1].
    past
        What became of the questions before.
    retries
        How often a step that failed is tried again.

    Examples
    --------
    >>> weigh(Prices(asking=5.0, failing=60.0), 0.4, Help(8, 8)).text
    'asking costs 5 and is expected to save 32.4: 0.60 failures, 60 each, 0.90 that it helps'
    >>> weigh(Prices(asking=5.0, failing=60.0), 0.4, Help(8, 8), retries=12).gain > 80
    True
    >>> weigh(Prices(asking=5.0, failing=60.0), 0.95, Help(8, 8)).asks
    False
    """
    miss = 1.0 - chance
    failures = sum(miss**number for number in range(1, retries + 2))
    gain = past.chance * failures * prices.failing
    text = (
        f"asking costs {prices.asking:g} and is expected to save {gain:.3g}: {failures:.2f} "
        f"failures, {prices.failing:g} each, {past.chance:.2f} that it helps"
    )
    return Worth(prices.asking < gain, gain, text)
