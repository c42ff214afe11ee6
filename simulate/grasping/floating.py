"""A gripper without an arm, to judge grasps by physics alone.

It moves along its approach, closes with a bounded force, lifts straight up and holds. It consists
of the boxes that planning checks for collisions; the object is any set of convex parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from grasp.spatial.gripper import ParallelGripper
from simulate.robots.description import Floats
from simulate.world.objects import Friction
from simulate.world.world import BodyPose, World

__all__ = ["FloatingGripper", "Held", "execute", "settle", "spawn_parts"]

_LIFT, _HAND, _LEFT, _RIGHT = range(4)
_APPROACH_M, _APPROACH_M_S = 0.05, 0.10
_CLOSE_S, _SQUEEZE_S, _HOLD_S = 0.5, 0.2, 0.5
_LIFT_M, _LIFT_M_S = 0.10, 0.15
_ARM_N = 800.0
_LIFTED_SHARE = 0.6
_STILL_M_S, _SETTLE_S = 0.004, 3.0


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
        Gap between the jaws at the end.
    """

    held: bool
    lifted_m: float
    turned_rad: float
    gap_m: float


def spawn_parts(
    world: World, parts: Sequence[Path], mass: float, origin: Sequence[float] = (0.0, 0.0, 0.0),
    friction: Friction | None = None,
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
    """
    client, rub = world.client, friction or Friction()
    shape = client.createCollisionShapeArray(
        shapeTypes=[client.GEOM_MESH] * len(parts),
        fileNames=[str(part) for part in parts],
        meshScales=[[1.0, 1.0, 1.0]] * len(parts),
        collisionFramePositions=[list(origin)] * len(parts),
        collisionFrameOrientations=[[0.0, 0.0, 0.0, 1.0]] * len(parts),
    )
    body = int(client.createMultiBody(mass, shape))
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
        up = orientation.inv().apply([0.0, 0.0, 1.0])
        boxes = gripper.boxes(opening)
        self.body = int(
            client.createMultiBody(
                baseMass=0.0,
                basePosition=start.tolist(),
                baseOrientation=orientation.as_quat().tolist(),
                linkMasses=[1.0, 1.0, 0.2, 0.2],
                linkCollisionShapeIndices=[
                    -1,
                    self._shape(boxes[2:], 0.0),
                    self._shape(boxes[:1], self._half),
                    self._shape(boxes[1:2], -self._half),
                ],
                linkVisualShapeIndices=[-1] * 4,
                linkPositions=[[0.0, 0.0, 0.0]] * 4,
                linkOrientations=[[0.0, 0.0, 0.0, 1.0]] * 4,
                linkInertialFramePositions=[[0.0, 0.0, 0.0]] * 4,
                linkInertialFrameOrientations=[[0.0, 0.0, 0.0, 1.0]] * 4,
                linkParentIndices=[0, 1, 2, 2],
                linkJointTypes=[client.JOINT_PRISMATIC] * 4,
                linkJointAxis=[up.tolist(), [0, 0, 1], [-1, 0, 0], [1, 0, 0]],
                flags=client.URDF_USE_SELF_COLLISION_EXCLUDE_ALL_PARENTS,
            )
        )
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
        self._drive(_LIFT, 0.0, 1.0, _ARM_N)
        self._drive(_HAND, 0.0, 1.0, _ARM_N)
        self._fingers(self._half, gripper.max_effort)

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
        self.world.step(_APPROACH_M / _APPROACH_M_S + 0.15)

    def close(self) -> None:
        """Close both fingers with the gripper's force."""
        self._fingers(0.0, self.gripper.max_effort)
        self.world.step(_CLOSE_S + _SQUEEZE_S)

    def lift(self) -> None:
        """Move straight up and hold."""
        self._drive(_LIFT, _LIFT_M, _LIFT_M_S, _ARM_N)
        self.world.step(_LIFT_M / _LIFT_M_S + _HOLD_S)

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


def execute(
    world: World, body: int, gripper: ParallelGripper, world_from_gripper: Floats, opening: float,
    rest: BodyPose, friction: float = 1.0,
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
    """
    client: Any = world.client
    client.resetBasePositionAndOrientation(body, rest.position.tolist(), rest.quaternion.tolist())
    client.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0])
    hand = FloatingGripper(world, gripper, world_from_gripper, opening, friction)
    try:
        hand.approach()
        hand.close()
        hand.lift()
        after = world.object_pose(body)
        lifted = after.z - rest.z
        turned = Rotation.from_matrix(after.rotation @ rest.rotation.T).magnitude()
        held = lifted > _LIFTED_SHARE * _LIFT_M and all(hand.touches(body))
        return Held(bool(held), float(lifted), float(turned), hand.gap)
    finally:
        hand.remove()
