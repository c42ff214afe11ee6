"""Grasps with three fingers about an axis: tried, closed, scored and ranked.

The fingers move together and push an object until it is jammed, between two of them or all three;
:mod:`grasp.spatial.three_finger.closing` finds where, :mod:`grasp.spatial.three_finger.forces` what
they then bear.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.clouds.cloud import prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.collision import Support, Surroundings, room_around
from grasp.spatial.grasp_plan import SpatialOptions
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.holding import CARRY_G, LIFT_G
from grasp.spatial.scoring.object_load import load_to_plan_for
from grasp.spatial.scoring.pose_errors import Judged, scored_under_errors
from grasp.spatial.scoring.select import diverse, rank
from grasp.spatial.three_finger.closing import Closing, close
from grasp.spatial.three_finger.forces import asked_of_fingers
from grasp.spatial.three_finger.hand import ThreeFingerHand

__all__ = [
    "plan_three_finger",
    "plan_three_finger_on_cloud",
]

_STARTS, _TURNS, _DEPTHS = 24, 8, 5
_WIDE_M, _ROOM_M, _MIN_ROOM_M = 0.025, 0.010, 0.006
_SCREENED, _SCORED = 600, 60
_OFF_M, _SAME_M, _SAME = 0.004, 0.002, 0.02
_GRAVITY = 9.81


def _asked(
    hand: ThreeFingerHand, closing: Closing, com: FloatArray, mass: float, up: FloatArray, g: float
) -> FloatArray:
    """Return the share of what the hand bears that a mass at ``com`` asks for at g, (n,)."""
    turn = closing.poses[:, :3, :3]
    force = np.einsum("nji,j->ni", turn, -g * mass * _GRAVITY * up)
    lever = np.einsum("nji,nj->ni", turn, com - closing.poses[:, :3, 3]) - closing.grip.middle
    return asked_of_fingers(hand, closing.grip, force, np.cross(lever, force))


def plan_three_finger(
    mesh: Mesh,
    hand: ThreeFingerHand,
    surroundings: Surroundings | None = None,
    options: SpatialOptions | None = None,
    given: FloatArray | None = None,
) -> Proposals:
    """Plan grasps of a mesh with three fingers.

    Parameters
    ----------
    surroundings
        Support and neighbours in the mesh's frame; None = the object floats alone, and "up" is z.
    given : (n, 4, 4) or None
        Poses in that frame from which the hand closes, instead of own ones.

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
    load = load_to_plan_for(mesh, options.mass, around.support)
    if isinstance(load, Proposals):
        return load
    notes, mass, up = (*mesh.notes, *load.notes), load.mass, load.up
    closed = close(mesh, hand, _starts(mesh, hand, up, options.seed) if given is None else given)
    fits = closed.holds & (2 * closed.radius + _MIN_ROOM_M <= hand.max_opening)
    counts = {"tried": len(fits), "fingers do not close on it": int((~closed.holds).sum())}
    counts["wider than the hand opens"] = int((closed.holds & ~fits).sum())
    chosen = np.flatnonzero(fits)
    if not len(chosen):
        reason = f"three fingers that open to {1000 * hand.max_opening:.0f} mm close on it nowhere"
        return Proposals(reason=reason, notes=notes, counts=counts)
    chosen = chosen[_first_of_each(closed.poses[chosen])]
    openings = np.minimum(2 * closed.radius + 2 * _ROOM_M, hand.max_opening)
    above = room_around(
        closed.poses[chosen], openings[chosen], hand, Surroundings(around.support)
    ).free
    counts["touches the support"] = int((~above).sum())
    chosen = chosen[above]
    # Rounded, so that rigid motions change nothing.
    asked = np.round(_asked(hand, closed, mesh.com, mass, up, CARRY_G)[chosen], 9)
    chosen = chosen[np.argsort(asked, kind="stable")[:_SCREENED]]
    poses = closed.poses[chosen]
    room = room_around(poses, openings[chosen], hand, around, mesh)
    # Wide open a hand bears more errors of the pose, where there is room for it.
    widest = np.minimum(2 * closed.radius + 2 * _WIDE_M, hand.max_opening)
    wide = room_around(poses, widest[chosen], hand, around, mesh).free
    openings = np.where(wide, widest[chosen], openings[chosen])
    counts.update({f"touches the {name}": n for name, n in room.hits().items() if n})
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
    shortlist = diverse(candidates, hand, most=_SCORED)
    scored = [_scored(candidate, mesh, hand, mass, up, around, options) for candidate in shortlist]
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
    table = None if support is None else support.plane
    cloud = complete_by_symmetry(prepare_cloud(points, table=table, viewpoints=viewpoints))
    if cloud.reason:
        return Proposals(reason=cloud.reason, notes=cloud.notes)
    surface = cloud.surface()
    if not len(surface.faces):
        return Proposals(reason="no surface is seen of the object", notes=cloud.notes)
    proposals = plan_three_finger(surface, hand, Surroundings(support, neighbours), options)
    return replace(proposals, notes=(*cloud.notes, *proposals.notes))


def _starts(mesh: Mesh, hand: ThreeFingerHand, up: FloatArray, seed: int) -> FloatArray:
    """Return poses (n, 4, 4) from which to close: along the vertical and the object's axes."""
    rng = np.random.default_rng(seed)
    points, _ = mesh.sample(400, rng)
    points = points - mesh.com
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    ways = [-up, *axes, *-axes]
    starts = []
    for way in (way for way in ways if way @ up < 0.5):  # no hand comes from below
        # A finger along the longest side that is seen along the way, or across it.
        level = axes - np.outer(axes @ way, way)
        x = level[int(np.linalg.norm(level, axis=1).round(6).argmax())]
        x /= np.linalg.norm(x)
        y = np.cross(way, x)
        heights = points @ way
        top, low = float(heights.min()), float(heights.max())
        deepest = min(top + hand.reach, low)
        # Halfway between two points of the surface there may be something to close on.
        pairs = points[rng.integers(len(points), size=(_STARTS - 1, 2))].mean(axis=1)
        places = np.vstack([np.zeros(3), pairs])
        depths = np.linspace(top + hand.fingertip / 2, deepest, _DEPTHS)
        above = low - hand.fingertip - _OFF_M  # as deep as what it stands on allows
        depths = np.unique(np.append(depths, np.clip(above, depths[0], depths[-1])))
        for angle in 2 * np.pi / 3 * np.arange(_TURNS) / _TURNS:
            c, s = np.cos(angle), np.sin(angle)
            turn = np.stack([c * x + s * y, c * y - s * x, way], axis=1)
            for depth in depths:
                poses = np.tile(np.eye(4), (len(places), 1, 1))
                poses[:, :3, :3] = turn
                poses[:, :3, 3] = mesh.com + places + np.outer(depth - places @ way, way)
                starts.append(poses)
    return np.concatenate(starts)


def _first_of_each(poses: FloatArray) -> NDArray[np.intp]:
    """Return the indices, in order, of poses (n, 4, 4) that repeat no earlier one.

    Fingers that close from different places come to rest in the same one.
    """
    place = np.round(poses[:, :3, 3] / _SAME_M)
    turn = np.round(poses[:, :3, :3].reshape(-1, 9) / _SAME)
    return np.sort(np.unique(np.hstack([place, turn]), axis=0, return_index=True)[1])


def _scored(
    candidate: GraspCandidate,
    mesh: Mesh,
    hand: ThreeFingerHand,
    mass: float,
    up: FloatArray,
    around: Surroundings,
    options: SpatialOptions,
) -> GraspCandidate:
    """Return a candidate with its scores under errors of the pose."""

    def judge(poses: FloatArray) -> Judged:
        opening = np.full(len(poses), candidate.opening)
        free = room_around(poses, opening, hand, Surroundings(sweep=around.sweep), mesh).free
        closed = close(mesh, hand, poses)
        return closed.holds & free, {
            name: _asked(hand, closed, mesh.com, mass, up, g)
            for name, g in (("lift", LIFT_G), ("carry", CARRY_G))
        }

    scored = scored_under_errors(candidate, options.noise, options.samples, options.seed, judge)
    lever = float(np.linalg.norm(mesh.com - candidate.frame_from_gripper[:3, 3]))
    return replace(scored, scores={**scored.scores, "lever": lever})
