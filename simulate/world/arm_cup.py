"""Suction cup at the end of an arm: switched like fingers, and read like them.

A closed hand is one whose vacuum is on. It reads as open by :data:`SEALED` while it holds
something, as closed fingers do on an object, and by 0 while it draws air.
"""

from __future__ import annotations

import numpy as np

from features.geometry import pose_matrix
from simulate.robots.description import Arm, Floats
from simulate.robots.other_hands import STAND_OFF_M
from simulate.world.vacuum import Vacuum
from simulate.world.world import World

__all__ = ["SEALED", "ArmCup"]

SEALED = 0.5
_TRY_S = 0.02
_TOUCH_M = 0.002


class ArmCup:
    """Cup of an arm, whose vacuum is tried every 20 ms while it is on.

    Parameters
    ----------
    world
        The physics world.
    arm
        With a cup.
    body, wrist
        The robot's body and the index of the link that carries the cup.
    """

    def __init__(self, world: World, arm: Arm, body: int, wrist: int) -> None:
        assert arm.cup is not None
        self._world, self._body, self._wrist = world, body, wrist
        self._wrist_from_lip = _wrist_from_lip(arm)
        self._vacuum = Vacuum(world, body, wrist, arm.cup, self._lip)
        self._on = False
        self._each = max(round(_TRY_S / world.preset.step_s), 1)
        self._steps = 0

    def switch(self, on: bool) -> None:
        """Switch the vacuum."""
        self._on = on
        if not on:
            self._vacuum.release()

    @property
    def held(self) -> int:
        """The body that it holds; -1 = none."""
        return self._vacuum.held

    @property
    def opening(self) -> float:
        """Reading of the vacuum as an opening of fingers."""
        return (SEALED if self._vacuum.held >= 0 else 0.0) if self._on else 1.0

    def before_step(self) -> None:
        """Seal, or let go of what is too much; to be called before each step of the physics."""
        self._steps += 1
        if self._vacuum.held >= 0:
            self._vacuum.watch()
        elif self._on and self._steps % self._each == 0:
            self._vacuum.seal(_TOUCH_M)

    def _lip(self) -> Floats:
        client = self._world.client
        state = client.getLinkState(self._body, self._wrist, computeForwardKinematics=True)
        pose = pose_matrix(np.reshape(client.getMatrixFromQuaternion(state[5]), (3, 3)), state[4])
        return np.asarray(pose @ self._wrist_from_lip)


def _wrist_from_lip(arm: Arm) -> Floats:
    approach, closing = np.array(arm.approach), np.array(arm.closing)
    return pose_matrix(
        np.stack([closing, np.cross(approach, closing), approach], axis=1),
        np.array(arm.tcp) - STAND_OFF_M * approach,
    )
