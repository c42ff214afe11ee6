"""Hands without an arm: a straight approach, a lift straight up, and shaking."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from grasp.spatial.gripper import ParallelGripper
from simulate.robots.description import Floats
from simulate.world.world import World

__all__ = ["APPROACH_M", "HAND", "LIFT_M", "FloatingGripper", "FloatingHand"]

_LIFT, _SWAY_X, _SWAY_Y, _ROCK, HAND, _LEFT, _RIGHT = range(7)
"""Joints, which are links as well; ``HAND`` slides along the approach."""
APPROACH_M, LIFT_M = 0.05, 0.10
_APPROACH_M_S = 0.20
_CLOSE_S, _SQUEEZE_S, _HOLD_S = 0.5, 0.2, 0.3
_LIFT_M_S = 0.15
_ARM_N = 800.0
_SHAKE_S, _RAMP_S, _REST_S = 1.25, 0.25, 0.15
_SWAY_M, _SWAY_HZ = 0.03, (4.0, 3.0)
_ROCK_RAD, _ROCK_HZ, _ROCK_N_M = float(np.deg2rad(35.0)), 0.8, 200.0


class FloatingHand:
    """A hand on a straight approach and a lift, of which what it closes with is still to come.

    Parameters
    ----------
    world
        The physics world.
    world_from_gripper : (4, 4)
        Pose in which it will close; it starts 5 cm back.
    palm : (n, 2, 3), m
        Boxes of the hand that do not move in it.
    fingers
        Of each finger its boxes (n, 2, 3), m, where its joint is at 0, and the axis of its joint.
    turns
        By how much the boxes of each finger are turned about the approach, rad; () = none is.
    """

    def __init__(
        self,
        world: World,
        world_from_gripper: Floats,
        palm: Floats,
        fingers: Sequence[tuple[Floats, Sequence[float]]] = (),
        turns: Sequence[float] = (),
    ) -> None:
        self.world = world
        client = world.client
        start = world_from_gripper[:3, 3] - APPROACH_M * world_from_gripper[:3, 2]
        orientation = Rotation.from_matrix(world_from_gripper[:3, :3])
        x, y, z = orientation.inv().apply(np.eye(3)).tolist()
        slides, rocks = client.JOINT_PRISMATIC, client.JOINT_REVOLUTE
        count, empty = HAND + 1 + len(fingers), [-1] * HAND
        self.body = int(
            client.createMultiBody(
                baseMass=0.0,
                basePosition=start.tolist(),
                baseOrientation=orientation.as_quat().tolist(),
                linkMasses=[1.0] * (HAND + 1) + [0.2] * len(fingers),
                linkCollisionShapeIndices=[
                    *empty, self._shape(palm),
                    *(
                        self._finger_shape(boxes, turn)
                        for (boxes, _), turn in zip(
                            fingers, turns or [0.0] * len(fingers), strict=True
                        )
                    ),
                ],
                linkVisualShapeIndices=[-1] * count,
                linkPositions=[[0.0, 0.0, 0.0]] * count,
                linkOrientations=[[0.0, 0.0, 0.0, 1.0]] * count,
                linkInertialFramePositions=[[0.0, 0.0, 0.0]] * count,
                linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0]] * count,
                linkParentIndices=[*range(HAND + 1), *[HAND + 1] * len(fingers)],
                linkJointTypes=[slides, slides, slides, rocks, *[slides] * (1 + len(fingers))],
                linkJointAxis=[z, x, y, x, [0, 0, 1], *(list(axis) for _, axis in fingers)],
                flags=client.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS,
            )
        )  # fmt: skip
        for empty_link in range(HAND):
            client.changeDynamics(
                self.body, empty_link, localInertiaDiagonal=[1e-3] * 3, linearDamping=0.0,
                angularDamping=0.0, jointDamping=0.0,
            )  # fmt: skip
        for joint in (_LIFT, _SWAY_X, _SWAY_Y, HAND):
            self._drive(joint, 0.0, 1.0, _ARM_N)
        self._drive(_ROCK, 0.0, 1.0, _ROCK_N_M)

    def _shape(self, boxes: Floats, turn: float = 0.0) -> int:
        """Return a collision shape of boxes (b, 2, 3), m, turned about the approach, rad."""
        client, turned = self.world.client, Rotation.from_rotvec([0.0, 0.0, turn])
        return int(
            client.createCollisionShapeArray(
                shapeTypes=[client.GEOM_BOX] * len(boxes),
                halfExtents=(np.ptp(boxes, axis=1) / 2).tolist(),
                collisionFramePositions=turned.apply(boxes.mean(axis=1)).tolist(),
                collisionFrameOrientations=[turned.as_quat().tolist()] * len(boxes),
            )
        )

    def _finger_shape(self, boxes: Floats, turn: float) -> int:
        """Return the collision shape of a finger; see :meth:`_shape`."""
        return self._shape(boxes, turn)

    def _drive(self, joint: int, target: float, speed: float, force: float) -> None:
        client = self.world.client
        client.setJointMotorControl2(
            self.body, joint, client.POSITION_CONTROL, targetPosition=target, force=force,
            maxVelocity=speed, positionGain=0.3, velocityGain=1.0,
        )  # fmt: skip

    @property
    def gap(self) -> float:
        """Between the jaws, m."""
        return 0.0

    def approach(self) -> None:
        """Move to the grasp pose."""
        self._drive(HAND, APPROACH_M, _APPROACH_M_S, _ARM_N)
        self.world.step(APPROACH_M / _APPROACH_M_S + 0.1)

    def close(self, body: int) -> None:
        """Take hold of a body."""
        raise NotImplementedError

    def holding(self, body: int, pull: Callable[[], None] | None) -> Callable[[], None] | None:
        """Return what happens before each step of the physics while a body is held."""
        return pull

    def touches(self, body: int) -> tuple[bool, ...]:
        """Tell for each finger whether it touches a body."""
        raise NotImplementedError

    def holds(self, body: int) -> bool:
        """Tell whether as many fingers touch a body as it takes to hold it."""
        return all(self.touches(body))

    def lift(self, pull: Callable[[], None] | None = None) -> None:
        """Move straight up and hold.

        Parameters
        ----------
        pull
            Called before each step of the physics.
        """
        self._drive(_LIFT, LIFT_M, _LIFT_M_S, _ARM_N)
        for _ in range(self._steps(LIFT_M / _LIFT_M_S + _HOLD_S)):
            if pull is not None:
                pull()
            self.world.step(0.0)

    def shake(self, pull: Callable[[], None] | None = None) -> None:
        """Sway by 3 cm at 4 and 3 Hz (peaks of 2 g), rock by 35 degrees, and come to rest."""
        client, step = self.world.client, self.world.preset.step_s
        for k in range(self._steps(_SHAKE_S + _REST_S)):
            now = min((k + 1) * step, _SHAKE_S)
            for joint, force, (target, speed) in zip(
                (_SWAY_X, _SWAY_Y, _ROCK), (_ARM_N, _ARM_N, _ROCK_N_M), _shaken(now), strict=True
            ):
                client.setJointMotorControl2(
                    self.body, joint, client.POSITION_CONTROL, targetPosition=target,
                    targetVelocity=speed, force=force, positionGain=0.3, velocityGain=1.0,
                )  # fmt: skip
            if pull is not None:
                pull()
            self.world.step(0.0)

    def _steps(self, seconds: float) -> int:
        return max(round(seconds / self.world.preset.step_s), 1)

    def remove(self) -> None:
        """Remove the hand from the world."""
        self.world.client.removeBody(self.body)


class FloatingGripper(FloatingHand):
    """Two fingers and a palm.

    Parameters
    ----------
    world, world_from_gripper
        See :class:`FloatingHand`.
    gripper
        Whose boxes and joints' force it has.
    opening
        Between the jaws, m.
    friction
        Of the fingers; physics multiplies it with the object's.
    """

    def __init__(
        self, world: World, gripper: ParallelGripper, world_from_gripper: Floats, opening: float,
        friction: float = 1.0,
    ) -> None:  # fmt: skip
        self.gripper, self._half = gripper, opening / 2
        boxes, shift = gripper.boxes(opening), np.array([self._half, 0.0, 0.0])
        fingers = ((boxes[:1] + shift, (-1, 0, 0)), (boxes[1:2] - shift, (1, 0, 0)))
        super().__init__(world, world_from_gripper, boxes[2:], fingers)
        client = world.client
        for finger in (_LEFT, _RIGHT):
            client.resetJointState(self.body, finger, self._half)
            client.changeDynamics(
                self.body, finger, lateralFriction=friction, spinningFriction=0.001,
                jointDamping=0.0,
            )  # fmt: skip
        self._gear = client.createConstraint(
            self.body, _LEFT, self.body, _RIGHT, client.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        client.changeConstraint(self._gear, gearRatio=-1, erp=0.2, maxForce=200)
        self._fingers(self._half, gripper.max_force)

    def _fingers(self, half: float, force: float) -> None:
        for finger in (_LEFT, _RIGHT):
            self._drive(finger, half, max(self._half, 0.01) / _CLOSE_S, force)

    @property
    def gap(self) -> float:
        """Between the jaws, m."""
        states = self.world.client.getJointStates(self.body, [_LEFT, _RIGHT])
        return float(states[0][0] + states[1][0])

    def close(self, body: int) -> None:
        """Close both fingers with the gripper's force."""
        self._fingers(0.0, self.gripper.max_force)
        self.world.step(_CLOSE_S + _SQUEEZE_S)

    def touches(self, body: int) -> tuple[bool, ...]:
        """Tell whether the left and the right finger touch a body."""
        client = self.world.client
        return (
            len(client.getContactPoints(self.body, body, linkIndexA=_LEFT)) > 0,
            len(client.getContactPoints(self.body, body, linkIndexA=_RIGHT)) > 0,
        )

    def remove(self) -> None:
        """Remove the gripper from the world."""
        self.world.client.removeConstraint(self._gear)
        super().remove()


def _shaken(now: float) -> list[tuple[float, float]]:
    """Return position and speed of both swaying joints (m) and the rocking one (rad) at a time."""
    moves = []
    for size, hertz in ((_SWAY_M, _SWAY_HZ[0]), (_SWAY_M, _SWAY_HZ[1]), (_ROCK_RAD, _ROCK_HZ)):
        turn = 2 * np.pi * hertz
        # Fading in and out: a sudden start would be a blow of any strength.
        before, after = now / _RAMP_S, (_SHAKE_S - now) / _RAMP_S
        fade = float(np.clip(min(before, after), 0.0, 1.0))
        slope = 0.0 if fade in (0.0, 1.0) else (1.0 if before < after else -1.0) / _RAMP_S
        sine, cosine = float(np.sin(turn * now)), float(np.cos(turn * now))
        moves.append((size * fade * sine, size * (fade * turn * cosine + slope * sine)))
    return moves
