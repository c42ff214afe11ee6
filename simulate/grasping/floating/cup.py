"""A suction cup without an arm, to judge where it takes hold by physics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from features.geometry import pose_matrix
from grasp.spatial.suction_cup import SuctionCup
from simulate.grasping.floating.execution import Conditions, Held, carry_out, misplaced_weight
from simulate.grasping.floating.hand import APPROACH_M, HAND, FloatingHand
from simulate.robots.description import Floats
from simulate.world.vacuum import Vacuum
from simulate.world.world import BodyPose, World

__all__ = ["FloatingCup", "execute_suction"]

_GUARD_M = 0.02
_SLOW_M_S, _PRESS_N = 0.10, 200.0
_EVACUATE_S = 0.1


class FloatingCup(FloatingHand):
    """A cup that stops at contact, and lets go of what asks too much of its vacuum.

    Parameters
    ----------
    world, world_from_gripper
        See :class:`~simulate.grasping.floating.hand.FloatingHand`.
    cup
        The suction cup.
    com_error : (3,), m
        Of the centre of mass, in the object's frame: the weight acts there.
    """

    def __init__(
        self,
        world: World,
        cup: SuctionCup,
        world_from_gripper: Floats,
        com_error: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        super().__init__(world, world_from_gripper, cup.boxes())
        self.vacuum = Vacuum(world, self.body, HAND, cup, self._pose, com_error)

    def _pose(self) -> Floats:
        """Return the pose (4, 4) of the lip."""
        state = self.world.client.getLinkState(self.body, HAND, computeForwardKinematics=True)
        return pose_matrix(
            np.reshape(self.world.client.getMatrixFromQuaternion(state[5]), (3, 3)), state[4]
        )

    def close(self, body: int) -> None:
        """Move on or back until the lip touches, and switch the vacuum on."""
        near = self.vacuum.gap()
        if not abs(near) <= _GUARD_M:
            return
        self._drive(HAND, APPROACH_M + near, _SLOW_M_S, _PRESS_N)
        self.world.step(abs(near) / _SLOW_M_S + _EVACUATE_S)
        self.vacuum.seal()

    def holding(self, body: int, pull: Callable[[], None] | None) -> Callable[[], None]:
        """Return what happens before each step: the cup lets go where its vacuum is exceeded."""

        def watch() -> None:
            if pull is not None:
                pull()
            self.vacuum.watch()

        return watch

    def touches(self, body: int) -> tuple[bool, ...]:
        """Tell whether the cup holds."""
        return (self.vacuum.held == body,)

    def remove(self) -> None:
        """Remove the cup from the world."""
        self.vacuum.release()
        super().remove()


def execute_suction(
    world: World,
    body: int,
    cup: SuctionCup,
    world_from_gripper: Floats,
    rest: BodyPose,
    conditions: Conditions | None = None,
) -> Held:
    """Take an object at its resting pose with a cup, lift it by 10 cm and check whether it is held.

    Parameters
    ----------
    body
        The object; it is put back to ``rest`` first.
    world_from_gripper : (4, 4)
        Where the cup was planned to touch; it stops at contact up to 2 cm before or behind.
    conditions
        Friction, centre of mass and shaking; None = the cup's own friction and a lift alone.
    """
    world.put(body, rest.position.tolist(), rest.quaternion.tolist())
    load = conditions or Conditions(friction=cup.friction)
    hand = FloatingCup(
        world, replace(cup, friction=load.friction), world_from_gripper, load.com_error
    )
    pull = misplaced_weight(world, body, load)
    return carry_out(world, body, hand, rest, pull, shaken=load.shake)
