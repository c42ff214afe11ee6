"""How long the whole motion of a grasp takes at least: to the object, to its place, and home."""

from __future__ import annotations

import numpy as np

from simulate.grasping.rules import PlannedGrasp
from simulate.motion.arm_space import SPEED
from simulate.motion.kinematics import Chain, Goal, IkOptions, solve_ik
from simulate.robots.description import Floats
from simulate.world.world import PlaceBox

__all__ = ["WholeMotion"]

_OVER_M = 0.12
"""Of the tool over the floor of a box, where the way down into it begins."""
_MAX_WARM = 16
_IK = IkOptions(starts=8, angle_tolerance=0.6, position_tolerance=0.01)


class WholeMotion:
    """Bounds the time that a grasp takes from home to home, by the posture at the object.

    Straight edges in joint space at the speeds of the phases, without what stands in their way: so
    a bound costs no search, and postures that cannot be the fastest need none.

    Parameters
    ----------
    chain
        The arm.
    home : (dof,) float, rad
        Posture at which the motion begins and ends.
    box
        Into which the object is put; None = not known, and the motion ends above the object.
    postures : (b, dof) float, rad
        At the object, b >= 1. Those over the box are looked for from them, as the transport does.
    """

    def __init__(self, chain: Chain, home: Floats, box: PlaceBox | None, postures: Floats) -> None:
        self._chain, self._home = chain, np.asarray(home)[None]
        self._over = postures[:0] if box is None else _over_box(chain, box, postures)

    def bounds(self, postures: Floats) -> Floats:
        """Return the bound (b,) of the way there and what comes after, for postures (b, dof), s."""
        there = self._edges(postures, self._home, SPEED["free"])[:, 0]
        return there + self._after(postures)

    def duration(self, planned: PlannedGrasp) -> float:
        """Return the time of a plan up to the end of its lift, and a bound of what is left, s."""
        ways = (planned.free, planned.approach, planned.lift)
        after = self._after(planned.lift.positions[-1:])
        return sum(way.duration for way in ways) + float(after[0])

    def _after(self, postures: Floats) -> Floats:
        """Return the bound (b,) of the transport to the box and the way home from there, s."""
        if not len(self._over):
            return np.zeros(len(postures))
        carried = self._edges(postures, self._over, SPEED["transport"])
        home = self._edges(self._over, self._home, SPEED["return"])[:, 0]
        return np.asarray((carried + home).min(axis=1))

    def _edges(self, start: Floats, end: Floats, speed: float) -> Floats:
        """Return the times (a, b) of straight edges between postures (a, dof) and (b, dof), s."""
        ways = np.abs(start[:, None] - end[None])
        return np.asarray((ways / (speed * self._chain.velocity)).max(axis=2))


def _over_box(chain: Chain, box: PlaceBox, postures: Floats) -> Floats:
    """Return postures (k, dof) over the middle of a box; k = 0 if there is none."""
    rotation, _ = chain.tool_poses(postures[:1])
    goal = Goal(
        np.array([*box.centre, box.floor + _OVER_M]),
        approach=rotation[0, :, 2] if chain.orients_freely else None,
        approach_must=chain.orients_freely,
    )
    return solve_ik(chain, goal, np.random.default_rng(0), _IK, warm=postures[:_MAX_WARM])
