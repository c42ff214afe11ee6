"""What makes attempts fail in truth, of which the graph knows nothing: one cause a trial.

It has no dynamics, and its rules are not those by which causes are inferred: a lever has a
threshold that varies, reports are drawn from lists of their own, and one attempt in twenty fails
without a cause.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

__all__ = ["KINDS", "OPEN_KINDS", "Deed", "Truth", "replaced"]

_HOLDS = 0.95
_REPORTS: Mapping[str, Mapping[str, float]] = {
    "centre_of_mass": {"slip_lift": 0.5, "slip_hold": 0.3, "slip_transport": 0.1, "touched": 0.1},
    "weak_zone": {"crushed": 0.7, "came_apart": 0.1, "slip_lift": 0.2},
    "slippery": {"slip_lift": 0.6, "slip_hold": 0.3, "slip_transport": 0.1},
    "wrong_identity": {"wrong_object": 0.4, "missed": 0.3, "slip_lift": 0.15, "touched": 0.15},
    "stale_place": {"missed": 0.6, "no_match": 0.3, "pushed_away": 0.1},
    "collision": {"approach_collision": 0.4, "grasp_collision": 0.2, "pregrasp_collision": 0.1,
                  "rrt_time": 0.2, "touched": 0.1},
    "late": {"timed_out": 0.7, "rrt_time": 0.3},
    "dropped": {"slip_transport": 0.6, "drop_outside": 0.4},
    "too_heavy": {"slip_lift": 0.4, "too_heavy": 0.3, "tracking": 0.2, "slip_hold": 0.1},
    "weak_hand": {"slip_lift": 0.5, "slip_hold": 0.25, "missed": 0.25},
    "hardware": {"hardware": 0.8, "tracking": 0.2},
    "out_of_reach": {"ik": 0.5, "approach_ik": 0.2, "lift_ik": 0.2, "tilt": 0.1},
}  # fmt: skip
KINDS = tuple(_REPORTS)
"""Kinds of failures that are injected."""
_OPEN_REPORTS: Mapping[str, Mapping[str, float]] = {
    "held_by_child": {"slip_lift": 0.4, "tracking": 0.3, "touched": 0.3},
    "power_sags": {"tracking": 0.4, "slip_hold": 0.3, "timed_out": 0.3},
    "camera_shifted": {"missed": 0.6, "touched": 0.2, "pushed_away": 0.2},
    "vacuum": {"slip_lift": 0.5, "slip_hold": 0.2, "came_apart": 0.3},
}
OPEN_KINDS = tuple(_OPEN_REPORTS)
"""Kinds that no hypothesis is about, and that no change mends: all robots fail on that occasion."""
_CURES = {"wrong_identity": "recognise", "stale_place": "look", "collision": "clear",
          "late": "earlier", "dropped": "look"}  # fmt: skip
_ANYWAY = ("missed", "slip_lift", "slip_hold", "touched")


@dataclass(frozen=True)
class Deed:
    """An attempt in truth.

    Parameters
    ----------
    robot
        Name of the robot.
    along
        Place of the grasp, in units of the thing's length from its middle.
    is_product
        Whether it was at the product that the cause is about.
    before
        Kind of a change that was made before; empty for none.
    """

    robot: str
    along: float
    is_product: bool = True
    before: str = ""


@dataclass
class Truth:
    """One cause.

    Parameters
    ----------
    kind
        One of :data:`KINDS`, or of :data:`OPEN_KINDS`.
    robot
        Name of the robot that fails.
    rng
        Of all chances.
    """

    kind: str
    robot: str
    rng: np.random.Generator
    side: float = field(init=False)
    size: float = field(init=False)

    def __post_init__(self) -> None:
        self.side = float(self.rng.choice([-1.0, 1.0]))
        self.size = float(self.rng.uniform(0.2, 0.4))

    def fails(self, deed: Deed, *, is_occasion: bool) -> bool:
        """Whether the cause makes an attempt fail.

        Parameters
        ----------
        is_occasion
            Whether it is the failure that is asked about, or a change of it.
        """
        if self.kind in OPEN_KINDS:
            return deed.is_product and is_occasion
        if self.kind in _CURES:
            return is_occasion and deed.before != _CURES[self.kind] and not self._gets_around(deed)
        rng, is_own = self.rng, deed.robot == self.robot
        if self.kind == "centre_of_mass":
            lever = abs(deed.along - self.side * self.size)
            return deed.is_product and lever > rng.uniform(0.12, 0.22)
        if self.kind == "weak_zone":
            return deed.is_product and self.side * deed.along > 0.5 - 1.5 * self.size
        if self.kind == "slippery":
            alike = deed.robot[:3] == self.robot[:3]
            return deed.is_product and rng.random() < (0.85 if alike else 0.3)
        if self.kind == "too_heavy":
            return deed.is_product and deed.robot.startswith("nao")
        if self.kind == "weak_hand":
            return is_own and rng.random() < 0.8
        return is_own and is_occasion  # hardware, out_of_reach

    def _gets_around(self, deed: Deed) -> bool:
        """Whether another way happens to do as well; only what stands in the way has one."""
        return (
            self.kind == "collision"
            and deed.before in ("grasp", "hand")
            and (self.rng.random() < 0.4)
        )

    def outcome(self, deed: Deed, *, is_occasion: bool = False) -> tuple[bool, str]:
        """Return whether an attempt holds, and what the robot reports."""
        if self.fails(deed, is_occasion=is_occasion):
            return False, self.report()
        if self.rng.random() < _HOLDS:
            return True, "ok"
        return False, _drawn(_ANYWAY, [0.25] * 4, self.rng)

    def report(self) -> str:
        """Return what a robot reports when the cause has made it fail."""
        reports = {**_REPORTS, **_OPEN_REPORTS}[self.kind]
        return _drawn(tuple(reports), list(reports.values()), self.rng)


def replaced(truth: Truth, rng: np.random.Generator) -> Truth:
    """Return the same cause with other chances."""
    result = copy.copy(truth)
    result.rng = rng
    return result


def _drawn(names: Sequence[str], chances: Sequence[float], rng: np.random.Generator) -> str:
    return names[int(rng.choice(len(names), p=chances))]
