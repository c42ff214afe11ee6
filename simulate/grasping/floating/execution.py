"""Grasps carried out by a gripper without an arm, to judge them by physics alone.

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
from simulate.grasping.floating.hand import LIFT_M, FloatingGripper, FloatingHand
from simulate.robots.description import Floats
from simulate.world.objects import Friction
from simulate.world.world import BodyPose, World

__all__ = [
    "Conditions",
    "Held",
    "carry_out",
    "execute",
    "misplaced_weight",
    "settle",
    "spawn_parts",
]

_LIFTED_SHARE = 0.6
_STILL_M_S, _SETTLE_S = 0.004, 3.0
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
        pull = misplaced_weight(world, body, conditions)
    return carry_out(
        world, body, FloatingGripper(world, gripper, world_from_gripper, opening, friction), rest,
        pull, shaken=conditions is not None and conditions.shake,
    )  # fmt: skip


def carry_out(
    world: World, body: int, hand: FloatingHand, rest: BodyPose,
    pull: Callable[[], None] | None = None, *, shaken: bool = False,
) -> Held:  # fmt: skip
    """Let a hand approach, close, lift and, if asked, shake; return the outcome, the hand removed.

    Parameters
    ----------
    body
        The object, at ``rest``.
    pull
        Called before each step of the physics from the lift on.
    """
    try:
        hand.approach()
        hand.close(body)
        if not any(hand.touches(body)):
            return Held(False, 0.0, 0.0, hand.gap, False if shaken else None)
        pull = hand.holding(body, pull)
        hand.lift(pull)
        after, gap = world.object_pose(body), hand.gap
        lifted = after.z - rest.z
        turned = Rotation.from_matrix(after.rotation @ rest.rotation.T).magnitude()
        held = lifted > _LIFTED_SHARE * LIFT_M and hand.holds(body)
        carried = None
        if shaken:
            if held:
                hand.shake(pull)
            higher = world.object_pose(body).z - rest.z > _LIFTED_SHARE * LIFT_M
            carried = held and higher and hand.holds(body)
        return Held(held, float(lifted), float(turned), gap, carried)
    finally:
        hand.remove()


def misplaced_weight(world: World, body: int, conditions: Conditions) -> Callable[[], None] | None:
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
