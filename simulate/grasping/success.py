"""When a grasp counts as held and an object as placed: predicates on what was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulate.robots.description import Floats
from simulate.world.world import PlaceBox

__all__ = ["LIFTED_M", "ObjectState", "held_reason", "is_placed", "lies_at"]

LIFTED_M = 0.02
"""An object that rose by less stands on the table still, or leans."""
MIN_LINKS = 2
_PLACED_BELOW_M = 0.09
_PLACED_WITHIN_M = 0.05


@dataclass(frozen=True, eq=False)
class ObjectState:
    """What is known of an object at one moment.

    Parameters
    ----------
    position : (3,) float, m
        Of its centre of mass.
    links
        Links of the hand that touch it.
    force_n
        Sum of their normal forces.
    on_table
        It touches the table.
    """

    position: Floats
    links: int = 0
    force_n: float = 0.0
    on_table: bool = False

    @property
    def is_finite(self) -> bool:
        """Whether physics still makes sense."""
        return bool(np.isfinite(self.position).all()) and bool(np.abs(self.position).max() < 10)


def held_reason(before: ObjectState, lifted: ObjectState, held: ObjectState) -> str:
    """Return ``ok`` when an object was lifted and stayed in the hand, else what went wrong.

    Held = the origin rose by more than 2 cm, is still there after the hold, at least two links of
    the hand touch it, and the table does not.

    Parameters
    ----------
    before, lifted, held
        The object before the lift, after it, and after the hold.
    """
    for state, reason in ((lifted, "slip_lift"), (held, "slip_hold")):
        if not state.is_finite:
            return "not_judged"
        risen = state.position[2] - before.position[2]
        if risen <= LIFTED_M or state.links < MIN_LINKS or state.on_table:
            return reason
    return "ok"


def is_placed(state: ObjectState, box: PlaceBox) -> bool:
    """Tell whether an object lies in a box: within its walls, less than 9 cm over the ground."""
    x, y, z = state.position
    inside = box.x_range[0] < x < box.x_range[1] and box.y_range[0] < y < box.y_range[1]
    return bool(inside and box.floor - 0.01 < z < box.floor + _PLACED_BELOW_M)


def lies_at(state: ObjectState, wanted: Floats, floor: float) -> bool:
    """Tell whether an object came to rest within 5 cm of (2,) m, less than 9 cm over the floor."""
    away = float(np.linalg.norm(state.position[:2] - wanted))
    return away < _PLACED_WITHIN_M and floor - 0.01 < state.position[2] < floor + _PLACED_BELOW_M
