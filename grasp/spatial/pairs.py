"""Pairs of opposed contacts on triangle meshes, sampled (after Nguyen 1988).

A point of the surface and a line inside its friction cone are drawn; the line's other crossings
tell where the second jaw would close. The outermost one within the stroke is what jaws meet that
come from outside; an earlier one counts where a finger finds room behind it, as at a cup's wall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray, IntArray
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import crossings

__all__ = ["NO_ROOM", "UNFIT", "Pairs", "antipodal_pairs"]


UNFIT = "too wide or too narrow for the stroke"
"""Reason for dropping a pair: its width."""

NO_ROOM = "no room for a finger beside it"
"""Reason for dropping a pair: an obstacle next to a contact."""

_SAME_M = 1e-4
_ROOM_M = 0.003


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
    spread: float = 1.0,
) -> Pairs:
    """Draw pairs of contacts whose line lies in both friction cones.

    Parameters
    ----------
    tries
        Points drawn on the surface.
    margin
        Space that each jaw keeps before closing, m: pairs wider than the stroke less twice this
        are dropped.
    spread
        Part of the friction cones that lines are drawn from; 0 = along the normals, so that pads
        lie flat on faces.

    Returns
    -------
    Pairs
        At most two for each try: the outermost far side and the nearest with room behind it.
    """
    if len(mesh.faces) == 0:
        none, nothing = np.empty((0, 3)), np.empty((0, 2, 3))
        return Pairs(nothing, nothing, none, none, np.empty(0), np.empty(0), {})
    rng = np.random.default_rng(seed)
    mu = gripper.friction
    points, face = mesh.sample(tries, rng)
    normals = mesh.normals[face]
    # Directions are drawn relative to an edge of the face, so that they move with the mesh.
    edges = mesh.vertices[mesh.faces[face, 1]] - mesh.vertices[mesh.faces[face, 0]]
    edges /= np.linalg.norm(edges, axis=1, keepdims=True)
    closing = _inside_cone(normals, edges, spread * np.arctan(mu), rng)
    stroke, finger = gripper.max_opening, gripper.thickness + _ROOM_M
    at, index, counts = crossings(mesh.tree, points, closing, -stroke, 2 * stroke)
    most = max(int(counts.max()), 1)
    at, index = at[:, :most], index[:, :most]
    at = np.where(np.arange(most) < counts[:, None], at, np.inf)
    facing = np.einsum("nki,ni->nk", mesh.tree.normals[index], closing)
    # The line meets the face that it starts from as well, at about 0.
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
        NO_ROOM: int((some & ~fits.any(axis=1)).sum()),
        "outside the friction cone": int(slips.sum()),
        UNFIT: int((~slips & unfit).sum()),
    }
    row, column, width = (a[~slips & ~unfit] for a in (row, column, width))
    d = closing[row]
    across = edges[row] - np.einsum("ni,ni->n", edges[row], d)[:, None] * d
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.where(length > 1e-6, across / np.maximum(length, 1e-12), _perpendicular(d))
    # Both jaws open by the same way, so the narrower side decides.
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
    normals: FloatArray, edges: FloatArray, widest: float, rng: np.random.Generator
) -> FloatArray:
    """Draw directions (n, 3) within ``widest`` rad of the inward normals."""
    # Without the root, directions would crowd along the axis of the cone.
    angle = widest * np.sqrt(rng.random(len(normals)))[:, None]
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
