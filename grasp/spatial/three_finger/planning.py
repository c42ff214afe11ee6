"""Grasps with three fingers about an axis: where they close, and what they then hold.

The fingers move together, so that they push an object until all three touch it: the axis moves to
where the three distances to the surface are equal. There each finger must meet the surface within
its friction cone; three equal forces towards the axis then balance, whatever their size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.clouds.cloud import prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.collision import HIT_BY, Support, Surroundings, room_around
from grasp.spatial.each_thing import plan_each_thing
from grasp.spatial.grasp_plan import SpatialOptions
from grasp.spatial.meshes.mesh import Mesh, surfels
from grasp.spatial.meshes.rays import NOTHING, first_and_last
from grasp.spatial.scoring.holding import CARRY_G, LIFT_G, assumed_mass
from grasp.spatial.scoring.pose_errors import Judged, scored_under_errors
from grasp.spatial.scoring.select import diverse, rank
from grasp.spatial.three_finger.hand import WAYS, ThreeFingerHand

__all__ = [
    "Closing",
    "asked_of_fingers",
    "close",
    "plan_three_finger",
    "plan_three_finger_on_cloud",
    "plan_three_finger_on_scene",
]

_ROUNDS, _SAME_M = 6, 5e-4
_STARTS, _TURNS, _DEPTHS = 24, 8, 5
_ROOM_M, _LEAST_ROOM_M = 0.010, 0.006
_SCREENED, _SCORED = 600, 60
_GRAVITY = 9.81
_SURFEL = 1.5


@dataclass(frozen=True, eq=False)
class Closing:
    """Rest position of fingers that close.

    Parameters
    ----------
    poses : (n, 4, 4)
        With the axis where all three fingers touch; the object's motion seen from the object.
    radius : (n,), m
        From the axis to the contacts.
    contacts, normals : (n, 3, 3), m
        In the frame of the mesh; normals out of the object.
    holds : (n,) bool
        Whether all touch within their friction cones.
    """

    poses: FloatArray
    radius: FloatArray
    contacts: FloatArray
    normals: FloatArray
    holds: NDArray[np.bool_]


def close(mesh: Mesh, hand: ThreeFingerHand, poses: FloatArray) -> Closing:
    """Close a hand on a mesh in poses (n, 4, 4), ``mesh_from_gripper``."""
    poses = np.array(poses, dtype=np.float64)
    ways = np.einsum("nij,kj->nki", poses[:, :3, :3], WAYS)
    at, face = _met(mesh, hand, poses, ways)
    for _ in range(_ROUNDS):
        # What moves the axis to equal distances if the surface is across each finger's way.
        step = 2 / 3 * np.einsum("nk,nki->ni", np.nan_to_num(at), ways)
        if np.abs(step).max(initial=0.0) < _SAME_M / 4:
            break
        poses[:, :3, 3] += step
        at, face = _met(mesh, hand, poses, ways)
    normals = mesh.normals[np.maximum(face, 0)]
    along = np.einsum("nki,nki->nk", normals, ways)
    least = float(np.cos(np.arctan(hand.friction)))
    with np.errstate(invalid="ignore"):
        radius = at.mean(axis=1)
        holds = (np.ptp(at, axis=1) < _SAME_M) & (along >= least).all(axis=1)
        holds &= (at.min(axis=1) > hand.min_opening / 2) & (radius <= hand.max_opening / 2)
    contacts = poses[:, None, :3, 3] + np.nan_to_num(at)[:, :, None] * ways
    return Closing(poses, radius, contacts, normals, np.asarray(holds))


def _met(
    mesh: Mesh, hand: ThreeFingerHand, poses: FloatArray, ways: FloatArray
) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return how far from the axis each finger meets the mesh (n, 3), NaN = nowhere, and where."""
    origins = np.repeat(poses[:, :3, 3], 3, axis=0)
    at, face = first_and_last(mesh.tree, origins, ways.reshape(-1, 3), hand.max_opening)
    far = np.where(face[:, 1] != NOTHING, at[:, 1], np.nan)
    return far.reshape(-1, 3), face[:, 1].reshape(-1, 3).astype(np.int64)


def asked_of_fingers(
    hand: ThreeFingerHand, force: FloatArray, moment: FloatArray, radius: FloatArray
) -> FloatArray:
    """Return what loads ask of a closed hand, as a share of what it bears: it holds below 1, (n,).

    Along the axis and about it the friction of three fingers bears the load; across the axis a
    finger must not be pushed open, and about a line across it friction acts up on one side and down
    on the other. The shares are combined as those of soft contacts (Howe and Cutkosky 1996).

    Parameters
    ----------
    force, moment : (n, 3), N and N m
        On the object in the gripper frame, about the middle of the contacts.
    radius : (n,), m

    Examples
    --------
    >>> hand = ThreeFingerHand("centric", 0.1)
    >>> weight = np.array([[0.0, 0.0, 15.0]])
    >>> [round(float(v), 2) for v in asked_of_fingers(hand, weight, 0 * weight, np.array([0.03]))]
    [0.5]
    """
    grip = hand.friction * hand.max_force
    lever = np.maximum(radius, 1e-3)
    shares = (
        force[:, 2] / (3 * grip),
        np.hypot(force[:, 0], force[:, 1]) / (1.5 * hand.max_force),
        moment[:, 2] / (3 * grip * lever),
        np.hypot(moment[:, 0], moment[:, 1]) / (1.5 * grip * lever),
    )
    return np.asarray(np.sqrt(sum(share**2 for share in shares)))


def _asked(
    hand: ThreeFingerHand, closing: Closing, com: FloatArray, mass: float, up: FloatArray, g: float
) -> FloatArray:
    """Return the share of what the hand bears that a mass at ``com`` asks for at g, (n,)."""
    turn = closing.poses[:, :3, :3]
    force = np.einsum("nji,j->ni", turn, -g * mass * _GRAVITY * up)
    lever = np.einsum("nji,nj->ni", turn, com - closing.poses[:, :3, 3])
    return asked_of_fingers(hand, force, np.cross(lever, force), closing.radius)


def plan_three_finger(
    mesh: Mesh,
    hand: ThreeFingerHand,
    surroundings: Surroundings | None = None,
    options: SpatialOptions | None = None,
) -> Proposals:
    """Plan grasps of a mesh with three fingers.

    Parameters
    ----------
    surroundings
        Support and neighbours in the mesh's frame; None = the object floats alone, and "up" is z.

    Returns
    -------
    Proposals
        Ranked. ``width`` is the diameter of the circle through the contacts. ``confidence`` is the
        share of pose errors under which the open hand gets there and all fingers close within their
        friction cones; ``lift`` and ``carry`` how likely it also holds the weight.

    Examples
    --------
    >>> from grasp.spatial.collision import Support
    >>> from grasp.spatial.meshes.shapes import sphere_mesh
    >>> ball, on_table = sphere_mesh(0.03), Surroundings(Support(-0.03))
    >>> best = plan_three_finger(ball, ThreeFingerHand("centric", 0.1), on_table)[0]
    >>> round(best.width, 2), best.scores["carry"] > 0.8
    (0.06, True)
    """
    options, around = options or SpatialOptions(), surroundings or Surroundings()
    if len(mesh.faces) == 0:
        return Proposals(reason="the mesh has no face", notes=mesh.notes)
    mass, notes = options.mass, mesh.notes
    if mass is None:
        mass = assumed_mass(mesh)
        notes = (*notes, f"ordered for an assumed mass of {mass:.2g} kg")
    up = np.array([0.0, 0.0, 1.0]) if around.support is None else around.support.up
    closed = close(mesh, hand, _starts(mesh, hand, up, options.seed))
    fits = closed.holds & (2 * closed.radius + _LEAST_ROOM_M <= hand.max_opening)
    counts = {"tried": len(fits), "fingers do not close on it": int((~closed.holds).sum())}
    counts["wider than the hand opens"] = int((closed.holds & ~fits).sum())
    chosen = np.flatnonzero(fits)
    if not len(chosen):
        reason = f"three fingers that open to {1000 * hand.max_opening:.0f} mm close on it nowhere"
        return Proposals(reason=reason, notes=notes, counts=counts)
    # Rounded, so that rigid motions change nothing.
    asked = np.round(_asked(hand, closed, mesh.com, mass, up, CARRY_G)[chosen], 9)
    chosen = chosen[np.argsort(asked, kind="stable")[:_SCREENED]]
    openings = np.minimum(2 * closed.radius[chosen] + 2 * _ROOM_M, hand.max_opening)
    room = room_around(closed.poses[chosen], openings, hand, around, mesh)
    for k, name in enumerate(HIT_BY):
        if k and (room.hit == k).any():
            counts[f"touches the {name}"] = int((room.hit == k).sum())
    candidates = [
        GraspCandidate(
            closed.poses[i], 2 * float(closed.radius[i]), contacts=closed.contacts[i],
            normals=closed.normals[i], opening=float(opening), scores={"clearance": float(away)},
        )
        for i, opening, free, away in zip(
            chosen, openings, room.free, room.clearance, strict=True
        )
        if free and (options.reachable is None or options.reachable(closed.poses[i]))
    ]  # fmt: skip
    if not candidates:
        reason = "the open hand touches something, or cannot be brought there, wherever it closes"
        return Proposals(reason=reason, notes=notes, counts=counts)
    kept = diverse(candidates, hand, most=_SCORED)
    scored = [_scored(one, mesh, hand, mass, up, around, options) for one in kept]
    return Proposals(tuple(rank(scored, up)[: options.most]), notes=notes, counts=counts)


def plan_three_finger_on_cloud(
    points: FloatArray,
    hand: ThreeFingerHand,
    support: Support | None = None,
    viewpoints: FloatArray | None = None,
    options: SpatialOptions | None = None,
    neighbours: FloatArray | None = None,
) -> Proposals:
    """Plan grasps of the object that a cloud shows, its hidden side completed where possible.

    Parameters
    ----------
    points : (n, 3), m
        Of one object, without its support.
    support
        In the frame of the points; None = it floats, and "up" is z.
    viewpoints : (k, 3) or None, m
        Where cameras were; None = seen from all around.
    neighbours : (m, 3) or None, m
        Points of what else stands there; None = nothing does.

    Returns
    -------
    Proposals
        As of :func:`plan_three_finger`.
    """
    table = None if support is None else np.array([*support.normal, -support.height])
    cloud = complete_by_symmetry(prepare_cloud(points, table=table, viewpoints=viewpoints))
    if cloud.reason:
        return Proposals(reason=cloud.reason, notes=cloud.notes)
    known = cloud.target & (np.linalg.norm(cloud.normals, axis=1) > 0)
    if not known.any():
        return Proposals(reason="no surface is seen of the object", notes=cloud.notes)
    surface = surfels(cloud.points[known], cloud.normals[known], _SURFEL * cloud.voxel)
    found = plan_three_finger(surface, hand, Surroundings(support, neighbours), options)
    return replace(found, notes=(*cloud.notes, *found.notes))


def plan_three_finger_on_scene(
    points: FloatArray,
    labels: NDArray[np.integer],
    hand: ThreeFingerHand,
    support: Support,
    viewpoints: FloatArray | None = None,
    options: SpatialOptions | None = None,
) -> Proposals:
    """Plan grasps of any thing of a scene, with the others around it.

    Parameters
    ----------
    points, labels
        As of :func:`~grasp.spatial.each_thing.plan_each_thing`.
    support, viewpoints, options
        As of :func:`plan_three_finger_on_cloud`.

    Returns
    -------
    Proposals
        As of :func:`~grasp.spatial.each_thing.plan_each_thing`.
    """
    options = options or SpatialOptions()

    def plan(own: FloatArray, others: FloatArray | None) -> Proposals:
        return plan_three_finger_on_cloud(own, hand, support, viewpoints, options, others)

    return plan_each_thing(points, labels, support.up, options.most, plan)


def _starts(mesh: Mesh, hand: ThreeFingerHand, up: FloatArray, seed: int) -> FloatArray:
    """Return poses (n, 4, 4) from which to close: along the vertical and the object's axes."""
    rng = np.random.default_rng(seed)
    points, _ = mesh.sample(400, rng)
    points = points - mesh.com
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    ways = [-up, *axes, *-axes]
    level = [way for way in ways if way @ up < 0.5]  # no hand comes from below
    found = []
    for way in level:
        x = np.cross(way, np.eye(3)[int(np.abs(way).argmin())])
        x /= np.linalg.norm(x)
        y = np.cross(way, x)
        heights = points @ way
        top, low = float(heights.min()), float(heights.max())
        deepest = min(top + hand.reach, low)
        # Halfway between two points of the surface there may be something to close on.
        pairs = points[rng.integers(len(points), size=(_STARTS - 1, 2))].mean(axis=1)
        places = np.vstack([np.zeros(3), pairs])
        depths = np.linspace(top + hand.fingertip / 2, deepest, _DEPTHS)
        for angle in 2 * np.pi / 3 * np.arange(_TURNS) / _TURNS:
            c, s = np.cos(angle), np.sin(angle)
            turn = np.stack([c * x + s * y, c * y - s * x, way], axis=1)
            for depth in depths:
                poses = np.tile(np.eye(4), (len(places), 1, 1))
                poses[:, :3, :3] = turn
                poses[:, :3, 3] = mesh.com + places + np.outer(depth - places @ way, way)
                found.append(poses)
    return np.concatenate(found)


def _scored(
    one: GraspCandidate,
    mesh: Mesh,
    hand: ThreeFingerHand,
    mass: float,
    up: FloatArray,
    around: Surroundings,
    options: SpatialOptions,
) -> GraspCandidate:
    """Return a candidate with its scores under errors of the pose."""

    def judge(poses: FloatArray) -> Judged:
        opening = np.full(len(poses), one.opening)
        free = room_around(poses, opening, hand, Surroundings(sweep=around.sweep), mesh).free
        closed = close(mesh, hand, poses)
        return closed.holds & free, {
            name: _asked(hand, closed, mesh.com, mass, up, g)
            for name, g in (("lift", LIFT_G), ("carry", CARRY_G))
        }

    scored = scored_under_errors(one, options.noise, options.samples, options.seed, judge)
    lever = float(np.linalg.norm(mesh.com - one.frame_from_gripper[:3, 3]))
    return replace(scored, scores={**scored.scores, "lever": lever})
