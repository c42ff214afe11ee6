"""Uncertainty of a remembered place: it grows with time, and with what happened nearby.

Two things happen to what nobody looks at. It drifts a little: it is nudged, and poses are compared
that were measured at different times. And it is carried off: nobody says so, and then it is
anywhere around. So the distance to the place where it was seen is drawn from one of two normal
distributions in the plane, a narrow one if the thing is still there and a wide one if it is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rtask.world.placement import Placement, Relation

__all__ = ["GROWTH", "MOVED_M", "NEARBY_M", "Growth", "Spread", "spread_of"]

_DAY_S = 86_400.0

MOVED_M = 0.02
"""Distance from which a thing has moved, m."""

NEARBY_M = 0.2
"""Distance within which the taking or putting of another thing may have touched this one, m."""


@dataclass(frozen=True)
class Growth:
    """Growth of the uncertainty at one kind of place.

    Parameters
    ----------
    drift_m
        Standard deviation per axis that a day adds, m.
    carried_off_a_day
        Rate at which things are carried off without anybody saying so.
    spread_m
        Standard deviation per axis of where a thing then is, m.
    touched
        Chance that an event nearby moved the thing.
    shifted_m
        Standard deviation per axis by which an event nearby shifts a thing that stays, m.
    """

    drift_m: float
    carried_off_a_day: float
    spread_m: float
    touched: float
    shifted_m: float = 0.0


GROWTH: dict[Relation, Growth] = {
    # The shift is fitted to simulated days. A hand that brushes in one of five takings against what
    # is within 20 cm, by 4 mm per axis, would give 1.3 mm if each event were a taking or a putting.
    "at": Growth(0.01, 0.5, 0.35, 0.08, 0.001),
    "on": Growth(0.01, 0.5, 0.35, 0.08, 0.001),
    "in": Growth(0.03, 0.25, 0.35, 0.02),
    "held_by": Growth(0.01, 24.0, 0.5, 0.0),
}
"""Growth by kind of place, assumed for a shared lab; only the shift is fitted to one."""


@dataclass(frozen=True)
class Spread:
    """Distribution of the distance in the plane between a remembered place and the true one.

    Parameters
    ----------
    sigma_m
        Standard deviation per axis while the thing is still there, m.
    still_there
        Chance of that, 0..1.
    spread_m
        Standard deviation per axis if it is not, m.

    Examples
    --------
    >>> Spread(0.01, 1.0, 0.35).radius(0.9) < 0.03
    True
    >>> Spread(0.01, 0.5, 0.35).radius(0.9) > 0.3
    True
    """

    sigma_m: float
    still_there: float
    spread_m: float

    def chance_within(self, radius_m: float) -> float:
        """Return the chance that the thing is within a distance."""
        near, far = (
            -math.expm1(-(radius_m**2) / (2.0 * sigma**2)) if sigma > 0 else 1.0
            for sigma in (self.sigma_m, math.hypot(self.sigma_m, self.spread_m))
        )
        return self.still_there * near + (1.0 - self.still_there) * far

    def radius(self, chance: float) -> float:
        """Return the distance, m, within which the thing is with this chance."""
        # Halving, since the sum of two such distributions has no inverse in closed form.
        low, high = 0.0, 10.0 * math.hypot(self.sigma_m, self.spread_m)
        for _ in range(50):
            middle = (low + high) / 2.0
            low, high = (middle, high) if self.chance_within(middle) < chance else (low, middle)
        return high


def spread_of(placement: Placement, time_s: float, events: int = 0, shifts: int = 0) -> Spread:
    """Return the spread of a placement at a time.

    Parameters
    ----------
    events
        Number of things that were taken or put nearby since it was last seen.
    shifts
        The same since its pose was measured.
    """
    growth = GROWTH[placement.relation]
    # A clock that was set back must not make a place surer than when it was seen.
    days = max(time_s - placement.confirmed, 0.0) / _DAY_S
    sigma = math.sqrt(
        # Independent errors add up by their squares.
        placement.sigma_m**2 + growth.drift_m**2 * days + growth.shifted_m**2 * shifts
    )
    still = math.exp(-growth.carried_off_a_day * days) * (1.0 - growth.touched) ** events
    return Spread(sigma, still, growth.spread_m)
