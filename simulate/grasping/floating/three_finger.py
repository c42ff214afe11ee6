"""A hand with three fingers and without an arm, to judge its grasps by physics."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from grasp.spatial.three_finger.hand import WAYS, ThreeFingerHand
from simulate.grasping.floating.execution import Conditions, Held, carry_out, misplaced_weight
from simulate.grasping.floating.hand import HAND, FloatingHand
from simulate.robots.description import Floats
from simulate.world.world import BodyPose, World

__all__ = ["FloatingThreeFinger", "execute_three_finger"]

_FINGERS = (HAND + 1, HAND + 2, HAND + 3)
_CLOSE_S, _SQUEEZE_S = 0.5, 0.2
_GEAR_N = 200.0


class FloatingThreeFinger(FloatingHand):
    """Three fingers that move together, and a palm.

    Parameters
    ----------
    world, world_from_gripper
        See :class:`~simulate.grasping.floating.hand.FloatingHand`.
    hand
        Whose sizes and force it has.
    opening
        Diameter of the circle between the fingers, m.
    """

    def __init__(
        self, world: World, hand: ThreeFingerHand, world_from_gripper: Floats, opening: float
    ) -> None:
        self.hand, self._radius = hand, opening / 2
        half, root = hand.finger_width / 2, hand.fingertip - hand.finger_length
        # Where its joint is at 0, a finger's pad lies on the axis.
        post = np.array([[(0.0, -half, root), (2 * half, half, hand.fingertip)]])
        fingers = [(post, way.tolist()) for way in WAYS]
        turns = np.arctan2(WAYS[:, 1], WAYS[:, 0]).tolist()
        super().__init__(world, world_from_gripper, hand.boxes(opening)[3:], fingers, turns)
        client = world.client
        for finger in _FINGERS:
            client.resetJointState(self.body, finger, self._radius)
            client.changeDynamics(
                self.body, finger, lateralFriction=1.0, spinningFriction=0.001, jointDamping=0.0
            )
        self._gears = []
        for other in _FINGERS[1:]:
            gear = client.createConstraint(
                self.body, _FINGERS[0], self.body, other, client.JOINT_GEAR, [1, 0, 0], [0, 0, 0],
                [0, 0, 0],
            )  # fmt: skip
            client.changeConstraint(gear, gearRatio=-1, erp=0.2, maxForce=_GEAR_N)
            self._gears.append(gear)
        self._move(self._radius)

    def _finger_shape(self, boxes: Floats, turn: float) -> int:
        """Return the collision shape of a round finger with these boxes around it."""
        client, box = self.world.client, boxes[0]
        centre = Rotation.from_rotvec([0.0, 0.0, turn]).apply(box.mean(axis=0))
        return int(
            client.createCollisionShape(
                client.GEOM_CYLINDER, radius=self.hand.finger_width / 2,
                height=float(np.ptp(box[:, 2])), collisionFramePosition=centre.tolist(),
            )
        )  # fmt: skip

    def _move(self, radius: float) -> None:
        for finger in _FINGERS:
            self._drive(finger, radius, max(self._radius, 0.01) / _CLOSE_S, self.hand.max_force)

    @property
    def gap(self) -> float:
        """Diameter of the circle between the fingers, m."""
        states = self.world.client.getJointStates(self.body, _FINGERS)
        return 2 * float(np.mean([state[0] for state in states]))

    def close(self, body: int) -> None:
        """Close all fingers with the hand's force."""
        self._move(0.0)
        self.world.step(_CLOSE_S + _SQUEEZE_S)

    def touches(self, body: int) -> tuple[bool, ...]:
        """Tell for each finger whether it touches a body."""
        contacts = self.world.client.getContactPoints
        return tuple(len(contacts(self.body, body, linkIndexA=finger)) > 0 for finger in _FINGERS)

    def holds(self, body: int) -> bool:
        """Tell whether two fingers or more touch a body: two opposed ones hold a bar."""
        return sum(self.touches(body)) > 1

    def remove(self) -> None:
        """Remove the hand from the world."""
        for gear in self._gears:
            self.world.client.removeConstraint(gear)
        super().remove()


def execute_three_finger(
    world: World,
    body: int,
    hand: ThreeFingerHand,
    world_from_gripper: Floats,
    opening: float,
    rest: BodyPose,
    conditions: Conditions | None = None,
) -> Held:
    """Take an object at its resting pose, lift it by 10 cm and check whether it is held.

    Parameters
    ----------
    body
        The object; it is put back to ``rest`` first.
    world_from_gripper : (4, 4)
        Where the hand was planned to close.
    opening
        Before closing, m.
    conditions
        Friction, centre of mass and shaking; None = the object's own friction and a lift alone.
    """
    world.put(body, rest.position.tolist(), rest.quaternion.tolist())
    pull = None
    if conditions is not None:
        world.client.changeDynamics(body, -1, lateralFriction=conditions.friction)
        pull = misplaced_weight(world, body, conditions)
    floating = FloatingThreeFinger(world, hand, world_from_gripper, opening)
    return carry_out(
        world, body, floating, rest, pull, shaken=conditions is not None and conditions.shake
    )
