"""A gripper without an arm, to judge grasps by physics alone.

It moves along its approach, closes with the hand's force, lifts straight up and holds; on request
it then shakes what it holds. It consists of the boxes that planning checks for collisions; the
object is any set of convex parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasp.spatial.gripper import ParallelGripper
from simulate.robots.description import Floats
from simulate.world.objects import Friction
from simulate.world.world import BodyPose, World

__all__ = ["Conditions", "FloatingGripper", "Held", "execute", "settle", "spawn_parts"]

_LIFT, _SWAY_X, _SWAY_Y, _ROCK, _HAND, _LEFT, _RIGHT = range(7)
_APPROACH_M, _APPROACH_M_S = 0.05, 0.20
_CLOSE_S, _SQUEEZE_S, _HOLD_S = 0.5, 0.2, 0.3
_LIFT_M, _LIFT_M_S = 0.10, 0.15
_ARM_N = 800.0
_LIFTED_SHARE = 0.6
_STILL_M_S, _SETTLE_S = 0.004, 3.0
_SHAKE_S, _RAMP_S, _REST_S = 1.25, 0.25, 0.15
_SWAY_M, _SWAY_HZ = 0.03, (4.0, 3.0)
_ROCK_RAD, _ROCK_HZ, _ROCK_N_M = float(np.deg2rad(35.0)), 0.8, 200.0
_GRAVITY = 9.81


@dataclass(frozen=True)
class Conditions:
    """The conditions that differ from one execution of a grasp to the next.

    Parameters
    ----------
    friction
        Coulomb coefficient between fingers and object.
    com_error : (3,), m
        How far the centre of mass is from where the physics has it, in the object's frame. Its
        weight acts there from the lift on; its inertia does not change.
    shake
        Whether the hand shakes after the lift.
    """

    friction: float = 0.5
    com_error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shake: bool = False


@dataclass(frozen=True)
class Held:
    """Outcome of a grasp.

    Parameters
    ----------
    held
        Whether both fingers hold the object at the top of the lift.
    lifted_m
        Rise of the object.
    turned_rad
        Rotation of the object in the hand.
    gap_m
        Gap between the jaws at the top of the lift.
    carried
        Whether both fingers still hold it after the shaking; None without shaking.
    """

    held: bool
    lifted_m: float
    turned_rad: float
    gap_m: float
    carried: bool | None = None


def spawn_parts(
    world: World, parts: Sequence[Path], mass: float, origin: Sequence[float] = (0.0, 0.0, 0.0),
    friction: Friction | None = None, seen: tuple[Path, Sequence[float]] | None = None,
) -> int:  # fmt: skip
    """Add an object made of convex mesh files to the world; return its body.

    Parameters
    ----------
    parts
        Convex meshes (OBJ, STL), in one frame, m.
    mass
        kg.
    origin
        Place of the meshes' origin in the body's frame, m: minus the centre of mass.
    seen
        The mesh that cameras see, in the same frame, and its colour (red, green, blue, alpha in
        0..1); None = they do not see it.
    """
    client, rub = world.client, friction or Friction()
    shape = client.createCollisionShapeArray(
        shapeTypes=[client.GEOM_MESH] * len(parts),
        fileNames=[str(part) for part in parts],
        meshScales=[[1.0, 1.0, 1.0]] * len(parts),
        collisionFramePositions=[list(origin)] * len(parts),
        collisionFrameOrientations=[[0.0, 0.0, 0.0, 1.0]] * len(parts),
    )
    visual = -1
    if seen is not None:
        mesh, colour = seen
        visual = client.createVisualShape(
            client.GEOM_MESH, fileName=str(mesh), rgbaColor=list(colour),
            visualFramePosition=list(origin),
        )  # fmt: skip
    body = int(client.createMultiBody(mass, shape, visual))
    client.changeDynamics(
        body, -1, lateralFriction=rub.lateral, spinningFriction=rub.spinning,
        rollingFriction=rub.rolling, linearDamping=rub.linear_damping,
        angularDamping=rub.angular_damping,
        activationState=client.ACTIVATION_STATE_DISABLE_SLEEPING,
    )  # fmt: skip
    return body


def settle(world: World, body: int) -> BodyPose:
    """Simulate up to 3 s until an object is at rest; return its pose."""
    for _ in range(int(_SETTLE_S / 0.1)):
        world.step(0.1)
        linear, angular = world.client.getBaseVelocity(body)
        if np.linalg.norm(linear) + 0.05 * np.linalg.norm(angular) < _STILL_M_S:
            break
    return world.object_pose(body)


class FloatingGripper:
    """Two fingers and a palm on a straight approach and a lift.

    Parameters
    ----------
    world
        The physics world.
    gripper
        Whose boxes and joints' force it has.
    world_from_gripper : (4, 4)
        Pose in which it will close; it starts 5 cm back.
    opening
        Between the jaws, m.
    friction
        Of the fingers; physics multiplies it with the object's.
    """

    def __init__(
        self, world: World, gripper: ParallelGripper, world_from_gripper: Floats, opening: float,
        friction: float = 1.0,
    ) -> None:  # fmt: skip
        self.world, self.gripper = world, gripper
        self._half = opening / 2
        client = world.client
        start = world_from_gripper[:3, 3] - _APPROACH_M * world_from_gripper[:3, 2]
        orientation = Rotation.from_matrix(world_from_gripper[:3, :3])
        x, y, z = orientation.inv().apply(np.eye(3)).tolist()
        boxes = gripper.boxes(opening)
        slides, turns = client.JOINT_PRISMATIC, client.JOINT_REVOLUTE
        empty = [-1] * _HAND
        self.body = int(
            client.createMultiBody(
                baseMass=0.0,
                basePosition=start.tolist(),
                baseOrientation=orientation.as_quat().tolist(),
                linkMasses=[1.0] * (_HAND + 1) + [0.2, 0.2],
                linkCollisionShapeIndices=[
                    *empty,
                    self._shape(boxes[2:], 0.0),
                    self._shape(boxes[:1], self._half),
                    self._shape(boxes[1:2], -self._half),
                ],
                linkVisualShapeIndices=[-1] * 7,
                linkPositions=[[0.0, 0.0, 0.0]] * 7,
                linkOrientations=[[0.0, 0.0, 0.0, 1.0]] * 7,
                linkInertialFramePositions=[[0.0, 0.0, 0.0]] * 7,
                linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0]] * 7,
                linkParentIndices=[0, 1, 2, 3, 4, 5, 5],
                linkJointTypes=[slides, slides, slides, turns, slides, slides, slides],
                linkJointAxis=[z, x, y, x, [0, 0, 1], [-1, 0, 0], [1, 0, 0]],
                flags=client.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS,
            )
        )
        for empty_link in range(_HAND):
            client.changeDynamics(
                self.body, empty_link, localInertiaDiagonal=[1e-3] * 3, linearDamping=0.0,
                angularDamping=0.0, jointDamping=0.0,
            )  # fmt: skip
        for finger in (_LEFT, _RIGHT):
            client.resetJointState(self.body, finger, self._half)
            client.changeDynamics(
                self.body,
                finger,
                lateralFriction=friction,
                spinningFriction=0.001,
                jointDamping=0.0,
            )
        self._gear = client.createConstraint(
            self.body, _LEFT, self.body, _RIGHT, client.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        client.changeConstraint(self._gear, gearRatio=-1, erp=0.2, maxForce=200)
        for joint in (_LIFT, _SWAY_X, _SWAY_Y, _HAND):
            self._drive(joint, 0.0, 1.0, _ARM_N)
        self._drive(_ROCK, 0.0, 1.0, _ROCK_N_M)
        self._fingers(self._half, gripper.max_force)

    def _shape(self, boxes: Floats, shift: float) -> int:
        """Return a collision shape of boxes (b, 2, 3), moved along x by ``shift`` m."""
        client = self.world.client
        middle = boxes.mean(axis=1) + np.array([shift, 0.0, 0.0])
        return int(
            client.createCollisionShapeArray(
                shapeTypes=[client.GEOM_BOX] * len(boxes),
                halfExtents=(np.ptp(boxes, axis=1) / 2).tolist(),
                collisionFramePositions=middle.tolist(),
            )
        )

    def _drive(self, joint: int, target: float, speed: float, force: float) -> None:
        client = self.world.client
        client.setJointMotorControl2(
            self.body, joint, client.POSITION_CONTROL, targetPosition=target, force=force,
            maxVelocity=speed, positionGain=0.3, velocityGain=1.0,
        )  # fmt: skip

    def _fingers(self, half: float, force: float) -> None:
        for finger in (_LEFT, _RIGHT):
            self._drive(finger, half, max(self._half, 0.01) / _CLOSE_S, force)

    @property
    def gap(self) -> float:
        """Between the jaws, m."""
        states = self.world.client.getJointStates(self.body, [_LEFT, _RIGHT])
        return float(states[0][0] + states[1][0])

    def approach(self) -> None:
        """Move to the grasp pose."""
        self._drive(_HAND, _APPROACH_M, _APPROACH_M_S, _ARM_N)
        self.world.step(_APPROACH_M / _APPROACH_M_S + 0.1)

    def close(self) -> None:
        """Close both fingers with the gripper's force."""
        self._fingers(0.0, self.gripper.max_force)
        self.world.step(_CLOSE_S + _SQUEEZE_S)

    def lift(self, pull: Callable[[], None] | None = None) -> None:
        """Move straight up and hold.

        Parameters
        ----------
        pull
            Called before each step of the physics.
        """
        self._drive(_LIFT, _LIFT_M, _LIFT_M_S, _ARM_N)
        for _ in range(self._steps(_LIFT_M / _LIFT_M_S + _HOLD_S)):
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

    def touches(self, body: int) -> tuple[bool, bool]:
        """Tell whether the left and the right finger touch a body."""
        client = self.world.client
        return (
            len(client.getContactPoints(self.body, body, linkIndexA=_LEFT)) > 0,
            len(client.getContactPoints(self.body, body, linkIndexA=_RIGHT)) > 0,
        )

    def remove(self) -> None:
        """Remove the gripper from the world."""
        self.world.client.removeConstraint(self._gear)
        self.world.client.removeBody(self.body)


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


def execute(
    world: World, body: int, gripper: ParallelGripper, world_from_gripper: Floats, opening: float,
    rest: BodyPose, friction: float = 1.0, conditions: Conditions | None = None,
) -> Held:  # fmt: skip
    """Grasp an object at its resting pose, lift it by 10 cm and check whether it is held.

    Parameters
    ----------
    body
        The object; it is put back to ``rest`` first.
    world_from_gripper : (4, 4)
        Where the gripper closes.
    opening
        Before closing, m.
    friction
        Of the fingers; physics multiplies it with the object's.
    conditions
        Friction, centre of mass and shaking; None = the object's own friction and a lift alone.
    """
    client: Any = world.client
    world.put(body, rest.position.tolist(), rest.quaternion.tolist())
    pull = None
    if conditions is not None:
        client.changeDynamics(body, -1, lateralFriction=conditions.friction / friction)
        pull = _misplaced_weight(world, body, conditions)
    hand = FloatingGripper(world, gripper, world_from_gripper, opening, friction)
    try:
        hand.approach()
        hand.close()
        if not any(hand.touches(body)):
            shaken = conditions is not None and conditions.shake
            return Held(False, 0.0, 0.0, hand.gap, False if shaken else None)
        hand.lift(pull)
        after, gap = world.object_pose(body), hand.gap
        lifted = after.z - rest.z
        turned = Rotation.from_matrix(after.rotation @ rest.rotation.T).magnitude()
        held = bool(lifted > _LIFTED_SHARE * _LIFT_M and all(hand.touches(body)))
        carried = None
        if conditions is not None and conditions.shake:
            if held:
                hand.shake(pull)
            higher = world.object_pose(body).z - rest.z > _LIFTED_SHARE * _LIFT_M
            carried = bool(held and higher and all(hand.touches(body)))
        return Held(held, float(lifted), float(turned), gap, carried)
    finally:
        hand.remove()


def _misplaced_weight(world: World, body: int, conditions: Conditions) -> Callable[[], None] | None:
    """Return what turns an object as if its weight acted beside its centre of mass, if it does."""
    offset = np.array(conditions.com_error, dtype=np.float64)
    if not offset.any():
        return None
    weight = _GRAVITY * float(world.client.getDynamicsInfo(body, -1)[0])

    def pull() -> None:
        place = world.object_pose(body)
        below = place.rotation @ offset
        for force, at in ((-weight, place.position + below), (weight, place.position)):
            world.client.applyExternalForce(
                body, -1, [0.0, 0.0, force], at.tolist(), world.client.WORLD_FRAME
            )

    return pull
