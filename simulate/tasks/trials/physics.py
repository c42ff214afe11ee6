"""The physics of a trial: a hand without an arm takes a thing in which a believed cause hides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grasp.spatial.frames import pose_from_planar
from grasp.spatial.gripper import ParallelGripper, parallel_jaw
from grasp.spatial.gripper_files import gripper_named
from rtask.tasks.diagnosis.attempt import Failure, Hand, Try
from rtask.tasks.diagnosis.hypotheses import Hypothesis
from simulate.grasping.floating.execution import execute
from simulate.world.hidden import Part, Secret
from simulate.world.objects import Friction, ObjectSpec
from simulate.world.world import World

__all__ = ["IN_PHYSICS", "MASS_KG", "draw_object", "draw_weakness", "grasp_holds", "gripper_of"]

IN_PHYSICS = ("centre_of_mass", "weak_zone", "slippery", "too_heavy", "weak_hand", "chance")
"""Kinds of causes that a hand and a thing alone show."""
MASS_KG = 0.1
"""Mass of a thing of which the graph does not say it."""
_NOISE_M, _NOISE_RAD = 0.002, float(np.deg2rad(3.0))
_MAX_TURN_RAD = float(np.deg2rad(40.0))
_SETTLE_S = 0.2
_SLIPPERY = (0.03, 0.15)
_TOO_HEAVY = (1.2, 2.0)
_WEAK_HAND = (0.05, 0.3)
_BREAKS_AT_N = 1.5
_MARGIN_M = 0.01


def gripper_of(hand: Hand) -> ParallelGripper | None:
    """Return the gripper of a hand's type, else plain jaws of its opening."""
    try:
        return gripper_named(hand.kind.removesuffix("_hand"))
    except (ValueError, OSError):
        return parallel_jaw(hand.opening) if hand.opening else None


def draw_object(failure: Failure, cause: Hypothesis, rng: np.random.Generator) -> ObjectSpec:
    """Return the thing with what a cause hides in it."""
    length, width = float(failure.length or 0.0), float(failure.width or 0.0)
    mass, friction, secret = failure.mass or MASS_KG, Friction(), Secret()
    start, end = cause.start or 0.0, cause.end or 0.0
    if cause.kind == "centre_of_mass":
        secret = Secret(mass_offset_m=(start + end) / 2)
    elif cause.kind == "weak_zone":
        secret = Secret(parts=_parts(length, width, start, end))
    elif cause.kind == "slippery":
        friction = replace(friction, lateral=float(rng.uniform(*_SLIPPERY)))
    elif cause.kind == "too_heavy":
        hand = failure.tried.hand
        gripper = gripper_of(hand)
        limit = hand.payload or (gripper.max_payload if gripper else None) or mass
        mass = max(mass, float(rng.uniform(*_TOO_HEAVY)) * limit)
    return ObjectSpec("carton", (length, width, width), mass, 0, "tried", friction, secret)


def _parts(length: float, width: float, start: float, end: float) -> tuple[Part, ...]:
    """Return a weak zone at one end, and the rest."""
    is_right = start + end > 0
    edge = start if is_right else end
    left, right = edge + length / 2, length / 2 - edge
    strong, weak = (left, right) if is_right else (right, left)
    side = 1.0 if is_right else -1.0
    return (
        Part((strong, width, width), (-side * weak / 2, 0.0, 0.0)),
        Part((weak, width, width), (side * strong / 2, 0.0, 0.0), breaks_at_n=_BREAKS_AT_N),
    )


def draw_weakness(cause: Hypothesis, rng: np.random.Generator) -> float:
    """Return the share of its force that the hand which failed has left."""
    return float(rng.uniform(*_WEAK_HAND)) if cause.kind == "weak_hand" else 1.0


def grasp_holds(
    world: World, thing: ObjectSpec, failure: Failure, tried: Try, weakness: float,
    rng: np.random.Generator,
) -> bool:  # fmt: skip
    """Carry a grasp out once at a new copy of the thing; tell whether it holds."""
    gripper = gripper_of(tried.hand)
    if gripper is None or tried.along is None:
        return False
    if tried.hand.iri == failure.tried.hand.iri:
        gripper = replace(gripper, max_force=weakness * gripper.max_force)
    width = float(failure.width or 0.0)
    opening = min(gripper.max_opening, width + _MARGIN_M)
    if opening <= width:
        return False
    x0 = world.workplace.table_near + world.workplace.table_size[0] / 2
    body = world.spawn(thing, (x0, 0.0))
    try:
        world.step(_SETTLE_S)
        x, y = rng.normal((x0 + tried.along, 0.0), _NOISE_M)
        theta = np.pi / 2 + rng.normal(0, _NOISE_RAD)
        height = world.table_height + max(width / 2, gripper.fingertip)
        pose = np.asarray(pose_from_planar(float(x), float(y), height, float(theta)))
        done = execute(world, body, gripper, pose, opening, world.object_pose(body))
        is_whole = body not in world.broken and not world.on_table(body)
        return bool(done.held and done.turned_rad < _MAX_TURN_RAD and is_whole)
    finally:
        world.remove(body)
