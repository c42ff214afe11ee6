"""Antipodal grasps on triangle meshes, sampled (after Nguyen 1988; ten Pas and Platt 2015).

A point of the surface and a line inside its friction cone are drawn; the line's other crossings
tell where the second jaw would close. The outermost one within the stroke is what jaws meet that
come from outside; an earlier one counts where a finger finds room behind it, as at a cup's wall.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasp.arrays import FloatArray, IntArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.collision import HIT_BY, Surroundings, room_around
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import MAX_HITS, NOTHING, crossings, first_and_last
from grasp.spatial.scoring.confidence import PoseNoise, closures

__all__ = ["Pairs", "antipodal_pairs", "propose_on_mesh"]


_UNFIT = "too wide or too narrow for the stroke"
_NO_ROOM = "no room for a finger beside it"
_SAME_M = 1e-4
_ROOM_M = 0.003
_OPEN_M = 0.02
_TIP_M = 0.002
_SCREEN, _SCREENED = 24, 600
_ROUNDS = 10
_ALIKE_M, _ALIKE = 0.005, np.sin(np.deg2rad(10))


@dataclass(frozen=True, eq=False)
class Pairs:
    """Two opposed contacts each, before the gripper's approach is chosen.

    Parameters
    ----------
    contacts, normals : (n, 2, 3)
        Row 0 is touched by the jaw at -x; normals out of the object.
    closing : (n, 3)
        Unit vectors from the first contact to the second.
    across : (n, 3)
        A unit vector perpendicular to each, fixed to the surface.
    widths : (n,), m
    room : (n,), m
        Largest opening with which both fingers find place on the line, at most the stroke.
    dropped
        How many tries failed, by why.
    """

    contacts: FloatArray
    normals: FloatArray
    closing: FloatArray
    across: FloatArray
    widths: FloatArray
    room: FloatArray
    dropped: dict[str, int]

    def __len__(self) -> int:
        return len(self.widths)

    def take(self, index: IntArray) -> Pairs:
        """Return some of them."""
        return Pairs(
            self.contacts[index], self.normals[index], self.closing[index], self.across[index],
            self.widths[index], self.room[index], self.dropped,
        )  # fmt: skip

    def poses(self, approach: FloatArray) -> FloatArray:
        """Return ``mesh_from_gripper`` (n, 4, 4) for approach directions (n, 3)."""
        poses = np.zeros((len(self), 4, 4))
        poses[:, :3, 0], poses[:, :3, 2] = self.closing, approach
        poses[:, :3, 1] = np.cross(approach, self.closing)
        poses[:, :3, 3] = self.contacts.mean(axis=1)
        poses[:, 3, 3] = 1.0
        return poses


def antipodal_pairs(
    mesh: Mesh,
    gripper: ParallelGripper,
    tries: int = 2000,
    seed: int = 0,
    margin: float = 0.004,
    friction: float | None = None,
) -> Pairs:
    """Draw pairs of contacts whose line lies in both friction cones.

    Parameters
    ----------
    tries
        Points drawn on the surface.
    margin
        Space that each jaw keeps before closing, m: pairs wider than the stroke less twice this
        are dropped.
    friction
        Coulomb coefficient; None = the gripper's.

    Returns
    -------
    Pairs
        At most two for each try: the outermost far side and the nearest with room behind it.
    """
    if len(mesh.faces) == 0:
        none, nothing = np.empty((0, 3)), np.empty((0, 2, 3))
        return Pairs(nothing, nothing, none, none, np.empty(0), np.empty(0), {})
    rng = np.random.default_rng(seed)
    mu = gripper.friction if friction is None else friction
    points, face = mesh.sample(tries, rng)
    normals = mesh.normals[face]
    edges = mesh.vertices[mesh.faces[face, 1]] - mesh.vertices[mesh.faces[face, 0]]
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    closing = _inside_cone(normals, edges, mu, rng)
    stroke, finger = gripper.max_opening, gripper.thickness + _ROOM_M
    at, index, counts = crossings(mesh.tree, points, closing, -stroke, 2 * stroke)
    at = np.where(np.arange(MAX_HITS) < counts[:, None], at, np.inf)
    facing = np.einsum("nki,ni->nk", mesh.tree.normals[index], closing)
    before = -np.where(at < -_SAME_M, at, -np.inf).max(axis=1)
    after = np.full(at.shape, np.inf)
    after[:, :-1] = at[:, 1:] - np.where(np.isfinite(at), at, 0.0)[:, :-1]
    leaves = (at > _SAME_M) & (at <= stroke) & (facing > 0)
    fits = leaves & (after > finger) & (before > finger)[:, None]
    row, column = _far_sides(leaves, fits)
    width = at[row, column]
    slips = facing[row, column] < np.cos(np.arctan(mu))
    unfit = (width > stroke - 2 * margin) | (width < gripper.min_opening)
    some = leaves.any(axis=1)
    dropped = {
        "nothing opposite within the stroke": int((~some).sum()),
        _NO_ROOM: int((some & ~fits.any(axis=1)).sum()),
        "outside the friction cone": int(slips.sum()),
        _UNFIT: int((~slips & unfit).sum()),
    }
    row, column, width = (a[~slips & ~unfit] for a in (row, column, width))
    d = closing[row]
    across = edges[row] - np.einsum("ni,ni->n", edges[row], d)[:, None] * d
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-6, across / np.maximum(length, 1e-12), _perpendicular(d))
    beside = np.minimum(before[row], after[row, column]) - finger
    return Pairs(
        np.stack([points[row], points[row] + width[:, None] * d], axis=1),
        np.stack([normals[row], mesh.tree.normals[index[row, column]]], axis=1),
        d,
        across,
        width,
        np.minimum(stroke, width + 2 * beside),
        dropped,
    )


def _inside_cone(
    normals: FloatArray, edges: FloatArray, mu: float, rng: np.random.Generator
) -> FloatArray:
    """Draw directions (n, 3) from the friction cones about the inward normals."""
    angle = np.arctan(mu) * np.sqrt(rng.random(len(normals)))[:, None]
    turn = (2 * np.pi * rng.random(len(normals)))[:, None]
    side = np.cos(turn) * edges + np.sin(turn) * np.cross(normals, edges)
    return np.asarray(-np.cos(angle) * normals + np.sin(angle) * side)


def _far_sides(leaves: NDArray[np.bool_], fits: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """Return tries and columns of far sides: each try's last exit, and its first with room."""
    rows = np.arange(len(leaves))
    last = leaves.shape[1] - 1 - np.argmax(leaves[:, ::-1], axis=1)
    first = np.argmax(fits, axis=1)
    outer = fits[rows, last] & leaves.any(axis=1)
    inner = fits.any(axis=1) & ~(outer & (first == last))
    return (
        np.concatenate([rows[outer], rows[inner]]),
        np.concatenate([last[outer], first[inner]]),
    )


def _perpendicular(d: FloatArray) -> FloatArray:
    """Return some unit vectors (n, 3) across unit vectors (n, 3)."""
    least = np.eye(3)[np.argmin(np.abs(d), axis=1)]
    across = np.cross(d, least)
    return np.asarray(across / np.linalg.norm(across, axis=1, keepdims=True))


def propose_on_mesh(
    mesh: Mesh,
    gripper: ParallelGripper,
    surroundings: Surroundings | None = None,
    *,
    tries: int = 2000,
    pairs: int = 60,
    turns: int | None = None,
    per_pair: int = 2,
    margin: float = 0.004,
    noise: PoseNoise | None = None,
    screen: bool = True,
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
    pairs
        Pairs of contacts that are looked at from all sides.
    turns
        Approach directions about the closing axis; None = 16 with a support, else 8.
    per_pair
        Free approaches that are kept of each pair.
    margin
        Space that each jaw keeps before closing, m.
    noise
        Under which pairs are compared before approaches are tried.
    screen
        Whether they are compared; else they come as drawn, good and bad.
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
    reason = _unfit(mesh, gripper, margin)
    if reason:
        return Proposals(reason=reason, notes=mesh.notes)
    found = antipodal_pairs(mesh, gripper, tries, seed, margin)
    counts = {"tried": tries, **found.dropped, "pairs": len(found)}
    if len(found) == 0:
        reason = f"no antipodal pair: {_why(found.dropped)}"
        return Proposals(reason=reason, notes=mesh.notes, counts=counts)
    if len(found) > _SCREENED:
        found = found.take(np.linspace(0, len(found) - 1, _SCREENED).astype(np.int64))
    order = np.random.default_rng(seed).permutation(len(found))
    if screen:
        order = _promising(found, mesh, gripper, noise or PoseNoise(), seed)
    count = turns if turns is not None else (8 if around.support is None else 16)
    candidates: list[GraspCandidate] = []
    hits: Counter[str] = Counter()
    for start in range(0, min(len(order), _ROUNDS * pairs), pairs):
        some = found.take(order[start : start + pairs])
        free, touched = _approached(some, mesh, gripper, around, count, per_pair)
        candidates += free
        hits.update(touched)
        if len(candidates) >= pairs // 3:
            break
    counts.update({f"touches the {name}": n for name, n in hits.items() if n})
    if not candidates:
        why = ", ".join(f"{name} ({n})" for name, n in hits.items() if n)
        reason = f"every approach touches something: {why}"
    return Proposals(tuple(candidates), reason, mesh.notes, counts)


def _why(dropped: dict[str, int]) -> str:
    """Return the most telling reason: what came nearest to a pair."""
    for name in (_UNFIT, _NO_ROOM):
        if dropped[name]:
            return name
    return max(dropped, key=lambda name: dropped[name])


def _unfit(mesh: Mesh, gripper: ParallelGripper, margin: float) -> str:
    """Return why there cannot be a grasp, or ""."""
    if len(mesh.faces) == 0:
        return "the mesh has no face"
    if gripper.max_opening <= 2 * margin:
        return (
            f"the stroke of {gripper.max_opening:.4g} m leaves nothing between margins of "
            f"{margin:.4g} m on both sides"
        )
    return ""


def _promising(
    found: Pairs, mesh: Mesh, gripper: ParallelGripper, noise: PoseNoise, seed: int
) -> IntArray:
    """Return the order of the pairs: those that close under most of a few perturbations first.

    Of several within 5 mm and 10 degrees one comes with the first, the others after all different.
    """
    poses = found.poses(found.across)
    held = closures(mesh, poses, gripper, noise.transforms(_SCREEN, seed), found.room)
    middle = found.contacts.mean(axis=1)
    arm = np.linalg.norm(np.cross(mesh.com - middle, found.closing), axis=1)
    score = np.round(held.mean(axis=1) - 0.3 * arm / max(mesh.radius, 1e-9), 9)
    order = np.argsort(-score, kind="stable")
    axis = found.closing
    if gripper.symmetric:
        # Equal for both senses of an axis, and as far apart in any frame.
        axis = np.einsum("ni,nj->nij", axis, axis).reshape(-1, 9) / np.sqrt(2)
    spots = np.hstack([middle / _ALIKE_M, axis / _ALIKE])
    kept: list[int] = []
    spare: list[int] = []
    tree = cKDTree(spots)
    taken = np.zeros(len(found), bool)
    for i in order.tolist():
        (spare if taken[i] else kept).append(i)
        if not taken[i]:
            taken[tree.query_ball_point(spots[i], 1.0)] = True
    return np.array(kept + spare, dtype=np.int64)


def _approached(
    found: Pairs, mesh: Mesh, gripper: ParallelGripper, around: Surroundings, turns: int, most: int
) -> tuple[list[GraspCandidate], dict[str, int]]:
    """Try approaches about each pair's closing axis; return the free ones, best first."""
    zero = found.across
    if around.support is not None:
        down = -around.support.up
        flat = down - (found.closing @ down)[:, None] * found.closing
        length = np.linalg.norm(flat, axis=1, keepdims=True)
        zero = np.where(length > 0.05, flat / np.maximum(length, 1e-9), zero)
    side = np.cross(found.closing, zero)
    angles = 2 * np.pi * np.arange(turns) / turns
    approaches = np.cos(angles)[:, None, None] * zero + np.sin(angles)[:, None, None] * side
    poses = np.concatenate([found.poses(approach) for approach in approaches])
    index = np.tile(np.arange(len(found)), turns)
    openings = np.minimum(found.room, found.widths + _OPEN_M)[index]
    depth = _depths(mesh, poses, gripper)
    _raise_over(poses, openings, gripper, around)
    room = room_around(poses, openings, gripper, around, mesh)
    free = room.free & (depth <= gripper.reach + gripper.fingertip)
    hits = {name: int((room.hit == k).sum()) for k, name in enumerate(HIT_BY) if k}
    steep = np.ones(len(poses))
    if around.support is not None:
        steep = -(poses[:, :3, 2] @ around.support.up)
    # From above where there is an above, else where the fingers reach least past the surface.
    # Rounded, so that equal ones are equal in every frame.
    preference = np.round(steep - 0.1 * depth / gripper.finger_length, 6)
    candidates = []
    for k in range(len(found)):
        mine = np.flatnonzero(free & (index == k))
        mine = mine[np.argsort(-preference[mine], kind="stable")][:most]
        for i in mine.tolist():
            candidates.append(
                GraspCandidate(
                    poses[i], float(found.widths[k]), float(depth[i]), found.contacts[k],
                    found.normals[k], "mesh", "full", opening=float(openings[i]),
                    scores={"clearance": float(room.clearance[i])},
                )
            )  # fmt: skip
    return candidates, hits


def _raise_over(
    poses: FloatArray, openings: FloatArray, gripper: ParallelGripper, around: Surroundings
) -> None:
    """Draw grippers that would touch the support back, as far as their pads still hold."""
    if around.support is None:
        return
    boxes = np.stack([gripper.boxes(float(o), around.sweep) for o in openings])
    lacking = around.support.clearance + 1e-6 - around.support.below(poses, boxes)
    steep = -(poses[:, :3, 2] @ around.support.up)
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
