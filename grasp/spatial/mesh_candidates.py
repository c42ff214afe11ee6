"""Collision-free grasps of triangle meshes from pairs of opposed contacts (ten Pas and Platt 2015).

The pairs that close under most errors of the pose come first, and with them those that a trivial
sampler would take: the most antipodal ones nearest to the centre of mass. Each is approached from
all sides, the steepest free approach first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from grasp.arrays import FloatArray, IntArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.collision import (
    LOW_M,
    SLIDE,
    Surroundings,
    room_around,
    swept_boxes,
)
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import NOTHING, first_and_last
from grasp.spatial.pairs import NO_ROOM, UNFIT, Pairs, antipodal_pairs
from grasp.spatial.scoring.confidence import PoseNoise, closures

__all__ = ["propose_on_mesh"]


_OPEN_M = 0.02
_TIP_M, _MARGIN_M = 0.002, 0.004
_PAIRS = 60
_SCREEN, _SCREENED = 24, 600
_ROUNDS = 10
_ALIKE_M, _ALIKE = 0.005, np.sin(np.deg2rad(10))


def propose_on_mesh(
    mesh: Mesh,
    gripper: ParallelGripper,
    surroundings: Surroundings | None = None,
    *,
    tries: int = 2000,
    per_pair: int = 2,
    noise: PoseNoise | None = None,
    screen: bool = True,
    central: int = 20,
    seed: int = 0,
) -> Proposals:
    """Propose collision-free grasps of a mesh, the most promising contacts first.

    Parameters
    ----------
    mesh
        Of the object; poses are in its frame.
    surroundings
        Support and neighbours in the mesh's frame.
    tries
        Points drawn on the surface.
    per_pair
        Free approaches that are kept of each pair.
    noise
        Under which pairs are compared before approaches are tried.
    screen
        Whether they are compared; else they come as drawn, good and bad.
    central
        Pairs that are looked at besides: those that lie flattest between the jaws, of them the
        nearest to the centre of mass.
    seed
        Of the points.

    Returns
    -------
    Proposals
        Not scored yet: see :func:`grasp.spatial.scoring.confidence.score_grasps`.

    Notes
    -----
    Everything is measured from the mesh, nothing from the axes of its frame: a rigid motion of
    mesh and surroundings moves the candidates with it.
    """
    around = surroundings or Surroundings()
    reason = _unfit(mesh, gripper)
    if reason:
        return Proposals(reason=reason, notes=mesh.notes)
    pairs = antipodal_pairs(mesh, gripper, tries, seed, _MARGIN_M)
    counts = {"tried": tries, **pairs.dropped, "pairs": len(pairs)}
    if len(pairs) == 0:
        reason = f"no antipodal pair: {_why(pairs.dropped)}"
        return Proposals(reason=reason, notes=mesh.notes, counts=counts)
    if len(pairs) > _SCREENED:
        pairs = pairs.take(np.linspace(0, len(pairs) - 1, _SCREENED).astype(np.int64))
    order = np.random.default_rng(seed).permutation(len(pairs))
    if screen:
        order = _promising(pairs, mesh, gripper, noise or PoseNoise(), seed)
    # On a support most approaches are blocked from below, so more are tried.
    count = 8 if around.support is None else 16
    candidates: list[GraspCandidate] = []
    hits: Counter[str] = Counter()
    for start in range(0, min(len(order), _ROUNDS * _PAIRS), _PAIRS):
        some = pairs.take(order[start : start + _PAIRS])
        free, touched = _approached(some, mesh, gripper, around, count, per_pair)
        candidates += free
        hits.update(touched)
        if len(candidates) >= _PAIRS // 3:
            break
    # Contacts drawn over the cones rarely lie flat on faces, where a grasp bears most.
    if central:
        straight = antipodal_pairs(mesh, gripper, tries, seed, _MARGIN_M, spread=0.0)
        if len(straight):
            near = straight.take(_central(straight, mesh, gripper)[:central])
            free, touched = _approached(near, mesh, gripper, around, count, per_pair)
            candidates += free
            hits.update(touched)
    counts.update({f"touches the {name}": n for name, n in hits.items() if n})
    if not candidates:
        why = ", ".join(f"{name} ({n})" for name, n in hits.items() if n)
        reason = f"every approach touches something: {why}"
    advice = _advice(mesh, around, hits) if not candidates else ""
    return Proposals(tuple(candidates), reason, mesh.notes, counts, advice)


def _advice(mesh: Mesh, around: Surroundings, hits: Mapping[str, int]) -> str:
    """Return what would help where every approach touches something."""
    if around.support is None or not hits.get("support"):
        return ""
    return SLIDE if float(np.ptp(mesh.vertices @ around.support.up)) <= LOW_M else ""


def _why(dropped: dict[str, int]) -> str:
    """Return the most telling reason: what came nearest to a pair."""
    for name in (UNFIT, NO_ROOM):
        if dropped[name]:
            return name
    return max(dropped, key=lambda name: dropped[name])


def _unfit(mesh: Mesh, gripper: ParallelGripper) -> str:
    """Return why there cannot be a grasp, or ""."""
    if len(mesh.faces) == 0:
        return "the mesh has no face"
    if gripper.max_opening <= 2 * _MARGIN_M:
        return (
            f"the stroke of {gripper.max_opening:.4g} m leaves nothing between margins of "
            f"{_MARGIN_M:.4g} m on both sides"
        )
    return ""


def _promising(
    pairs: Pairs, mesh: Mesh, gripper: ParallelGripper, noise: PoseNoise, seed: int
) -> IntArray:
    """Return the order of the pairs: those that close under most of a few perturbations first.

    Of several within 5 mm and 10 degrees one comes with the first, the others after all different.
    """
    poses = pairs.poses(pairs.across)
    held = closures(mesh, poses, gripper, noise.transforms(_SCREEN, seed), pairs.room)
    middle = pairs.contacts.mean(axis=1)
    arm = np.linalg.norm(np.cross(mesh.com - middle, pairs.closing), axis=1)
    score = np.round(held.mean(axis=1) - 0.3 * arm / max(mesh.radius, 1e-9), 9)
    order = np.argsort(-score, kind="stable")
    distinct, spare = _thinned(pairs, order, gripper)
    return np.array(distinct + spare, dtype=np.int64)


def _central(pairs: Pairs, mesh: Mesh, gripper: ParallelGripper) -> IntArray:
    """Return different pairs, the most antipodal ones nearest to the centre of mass first."""
    along = np.einsum("nki,ni->nk", pairs.normals, pairs.closing) * (-1.0, 1.0)
    away = np.linalg.norm(pairs.contacts.mean(axis=1) - mesh.com, axis=1)
    # Rounded, so that the triangles of one plane and rigid motions change nothing.
    order = np.lexsort((np.round(away, 9), -np.round(along.min(axis=1), 2)))
    return np.array(_thinned(pairs, order, gripper)[0], dtype=np.int64)


def _thinned(
    pairs: Pairs, order: IntArray, gripper: ParallelGripper
) -> tuple[list[int], list[int]]:
    """Return the first of pairs within 5 mm and 10 degrees of each other, and the others."""
    axis = pairs.closing
    if gripper.symmetric:
        # Equal for both senses of an axis, and as far apart in any frame.
        axis = np.einsum("ni,nj->nij", axis, axis).reshape(-1, 9) / np.sqrt(2)
    spots = np.hstack([pairs.contacts.mean(axis=1) / _ALIKE_M, axis / _ALIKE])
    distinct: list[int] = []
    spare: list[int] = []
    tree = cKDTree(spots)
    taken = np.zeros(len(pairs), bool)
    for i in order.tolist():
        (spare if taken[i] else distinct).append(i)
        if not taken[i]:
            # Facets may be exactly this far apart, whatever a frame's rounding makes of it.
            taken[tree.query_ball_point(spots[i], 1.0 + 1e-6)] = True
    return distinct, spare


def _approached(
    pairs: Pairs, mesh: Mesh, gripper: ParallelGripper, around: Surroundings, turns: int, most: int
) -> tuple[list[GraspCandidate], dict[str, int]]:
    """Try approaches about each pair's closing axis; return the free ones, best first."""
    zero = pairs.across
    if around.support is not None:
        down = -around.support.up
        flat = down - (pairs.closing @ down)[:, None] * pairs.closing
        length = np.linalg.norm(flat, axis=1, keepdims=True)
        # A closing axis that is almost vertical leaves no approach from above.
        zero = np.where(length > 0.05, flat / np.maximum(length, 1e-9), zero)
    side = np.cross(pairs.closing, zero)
    angles = 2 * np.pi * np.arange(turns) / turns
    approaches = np.cos(angles)[:, None, None] * zero + np.sin(angles)[:, None, None] * side
    index = np.tile(np.arange(len(pairs)), turns)
    poses = pairs.take(index).poses(approaches.reshape(-1, 3))
    openings = np.minimum(pairs.room, pairs.widths + _OPEN_M)[index]
    depth = _depths(mesh, poses, gripper)
    _raise_over(poses, openings, gripper, around)
    room = room_around(poses, openings, gripper, around, mesh)
    free = room.free & (depth <= gripper.reach + gripper.fingertip)
    steep = np.ones(len(poses))
    if around.support is not None:
        steep = -(poses[:, :3, 2] @ around.support.up)
    # From above where there is an above, else where the fingers reach least past the surface.
    # Rounded, so that equal ones are equal in every frame.
    preference = np.round(steep - 0.1 * depth / gripper.finger_length, 6)
    candidates = []
    for k in range(len(pairs)):
        mine = np.flatnonzero(free & (index == k))
        mine = mine[np.argsort(-preference[mine], kind="stable")][:most]
        for i in mine.tolist():
            candidates.append(
                GraspCandidate(
                    poses[i], float(pairs.widths[k]), float(depth[i]), pairs.contacts[k],
                    pairs.normals[k], "mesh", "full", opening=float(openings[i]),
                    scores={"clearance": float(room.clearance[i])},
                )
            )  # fmt: skip
    return candidates, room.hits()


def _raise_over(
    poses: FloatArray, openings: FloatArray, gripper: ParallelGripper, around: Surroundings
) -> None:
    """Draw grippers that would touch the support back, as far as their pads still hold."""
    if around.support is None:
        return
    boxes = swept_boxes(gripper, openings, around.sweep)
    lacking = around.support.clearance + 1e-6 - around.support.below(poses, boxes)
    steep = -(poses[:, :3, 2] @ around.support.up)
    # Along the approach, which a slanted gripper has to leave further to rise as much.
    back = lacking / np.maximum(steep, 1e-3)
    shift = np.where((lacking > 0) & (back <= gripper.fingertip - _TIP_M), back, 0.0)
    poses[:, :3, 3] -= shift[:, None] * poses[:, :3, 2]


def _depths(mesh: Mesh, poses: FloatArray, gripper: ParallelGripper) -> FloatArray:
    """Return how far the fingertips reach past the first surface on the approach (n,), m."""
    at, face = first_and_last(
        mesh.tree, poses[:, :3, 3], poses[:, :3, 2], 2 * gripper.finger_length
    )
    first = np.where(face[:, 0] != NOTHING, at[:, 0], gripper.fingertip)
    return np.clip(gripper.fingertip - first, 0.0, None)
