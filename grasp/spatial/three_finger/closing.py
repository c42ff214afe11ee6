"""Closing of three coupled fingers on a mesh: what they push, and where they come to rest.

The finger that touches first pushes the object before it until a second one touches; unless these
two jam it, it slides along both to the third. The object is moved without being turned, and each
contact is taken on the plane of the face that is met.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import NOTHING, first_and_last
from grasp.spatial.three_finger.forces import Grip, gripped
from grasp.spatial.three_finger.hand import WAYS, ThreeFingerHand

__all__ = ["Closing", "close"]

_ROUNDS, _SAME_M = 12, 5e-4
_SURE = 0.6
"""Share of the friction that must be enough to jam an object between two fingers; it slides on
where it might, as friction is not well known."""
_CLOSING, _LONGEST_M = 0.1, 0.05
_SHALLOW = 0.2
"""Cosine between a finger's way and the normal below which it slides past rather than pushes."""


@dataclass(frozen=True, eq=False)
class Closing:
    """Rest position of fingers that close.

    Parameters
    ----------
    poses : (n, 4, 4)
        ``mesh_from_gripper`` at rest: the object's motion, seen from the object.
    radius : (n,), m
        From the axis to the inside of the fingers.
    contacts, normals : (n, 3, 3), m
        In the frame of the mesh; normals out of the object.
    touching : (n, 3) bool
        Fingers that have come to a contact; two are enough to hold.
    grip
        Forces between them.
    holds : (n,) bool
        Whether forces balance within what the hand opens.
    """

    poses: FloatArray
    radius: FloatArray
    contacts: FloatArray
    normals: FloatArray
    touching: NDArray[np.bool_]
    grip: Grip
    holds: NDArray[np.bool_]


def close(mesh: Mesh, hand: ThreeFingerHand, poses: FloatArray) -> Closing:
    """Close a hand on a mesh in poses (n, 4, 4), ``mesh_from_gripper``."""
    poses = np.array(poses, dtype=np.float64)
    ways = np.einsum("nij,kj->nki", poses[:, :3, :3], WAYS)
    at, normals = _met(mesh, hand, poses, ways)
    moving = np.arange(len(poses))
    for _ in range(_ROUNDS):
        touching = _touching(at[moving])
        now = poses[moving], ways[moving], normals[moving], at[moving]
        jammed = _grip(hand, *now, touching, _SURE * hand.friction).holds
        step, able = _step(*now[1:], touching)
        moving, step = moving[~jammed & able], step[~jammed & able]
        if not len(moving):
            break
        poses[moving, :3, 3] += step
        at[moving], normals[moving] = _met(mesh, hand, poses[moving], ways[moving])
    touching = _touching(at)
    grip = _grip(hand, poses, ways, normals, at, touching)
    radius = np.nan_to_num(at).max(axis=1)
    holds = grip.holds & (radius > hand.min_opening / 2) & (radius <= hand.max_opening / 2)
    contacts = _contacts(hand, poses, ways, normals, at)
    return Closing(poses, radius, contacts, normals, touching, grip, np.asarray(holds))


def _met(
    mesh: Mesh, hand: ThreeFingerHand, poses: FloatArray, ways: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how far from the axis the inside of each finger is at contact, and normals there.

    Distances (n, 3), m, NaN = it meets nothing; normals (n, 3, 3). A round finger meets a face that
    is oblique to its way beside its middle, and so further out than the line of its way does.
    """
    origins = np.repeat(poses[:, :3, 3], 3, axis=0)
    at, face = first_and_last(mesh.tree, origins, ways.reshape(-1, 3), hand.max_opening)
    normals = mesh.normals[np.maximum(face[:, 1], 0)].reshape(ways.shape)
    along = np.einsum("nki,nki->nk", normals, ways)
    far = np.where(face[:, 1] != NOTHING, at[:, 1], np.nan).reshape(along.shape)
    far = np.where(along > _SHALLOW, far, np.nan)
    return far + hand.finger_width / 2 * (1 / np.maximum(along, _SHALLOW) - 1), normals


def _touching(at: FloatArray) -> NDArray[np.bool_]:
    """Return which fingers (n, 3) touch when the first ones do: all have the same radius."""
    depths = np.where(np.isnan(at), -np.inf, at)
    return np.asarray(depths >= depths.max(axis=1, keepdims=True) - _SAME_M) & np.isfinite(at)


def _contacts(
    hand: ThreeFingerHand, poses: FloatArray, ways: FloatArray, normals: FloatArray, at: FloatArray
) -> FloatArray:
    """Return where round fingers touch (n, 3, 3), m, frame of the mesh; the axis for none."""
    half = hand.finger_width / 2
    middle = poses[:, None, :3, 3] + (np.nan_to_num(at) + half)[:, :, None] * ways
    axis = poses[:, None, :3, 2]
    level = normals - np.einsum("nki,nki->nk", normals, axis + 0 * normals)[:, :, None] * axis
    level /= np.maximum(np.linalg.norm(level, axis=2), 1e-9)[:, :, None]
    return np.where(np.isnan(at)[:, :, None], poses[:, None, :3, 3], middle - half * level)


def _grip(
    hand: ThreeFingerHand,
    poses: FloatArray,
    ways: FloatArray,
    normals: FloatArray,
    at: FloatArray,
    touching: NDArray[np.bool_],
    friction: float | None = None,
) -> Grip:
    turn = poses[:, :3, :3]
    places = _contacts(hand, poses, ways, normals, at) - poses[:, None, :3, 3]
    return gripped(
        hand,
        np.einsum("nji,nkj->nki", turn, places)[:, :, :2],
        np.einsum("nji,nkj->nki", turn, normals),
        touching,
        friction,
    )


def _step(
    ways: FloatArray, normals: FloatArray, at: FloatArray, touching: NDArray[np.bool_]
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return by how much the axis moves (n, 3), m, until a further finger touches, and if it can.

    On planes, a finger's distance changes by - n.s / n.w with a step s. One finger pushes along its
    way; two let the object slide along both faces, which takes both inwards by the same amount.
    """
    along = np.einsum("nki,nki->nk", normals, ways)
    rate = -normals / np.where(np.abs(along) > 1e-9, along, 1.0)[:, :, None]
    order = np.argsort(np.where(np.isnan(at), np.inf, -at), axis=1, kind="stable")
    rows = np.arange(len(at))
    a, b, _ = order.T
    single = touching.sum(axis=1) == 1
    first, second = rate[rows, a], rate[rows, b]
    # Of two fingers: the least step across the axis whose rates are -1 for both.
    axis = np.cross(ways[:, 0], ways[:, 1])
    across = np.stack([first, second, axis], axis=1)
    sound = np.abs(np.linalg.det(across)) > 0.05
    across[~sound] = np.eye(3)
    both = np.linalg.solve(across, np.broadcast_to([-1.0, -1.0, 0.0], (len(at), 3))[..., None])
    way = np.where(single[:, None], ways[rows, a], both[..., 0])
    gaps = at[rows, a][:, None] - at[rows[:, None], order[:, 1:]]
    closing = 1 + np.einsum("nki,ni->nk", rate[rows[:, None], order[:, 1:]], way)
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = np.where(closing > _CLOSING, gaps / closing, np.inf)
    lengths = np.where(np.isnan(lengths), np.inf, lengths)
    lengths[~single, 0] = np.inf  # touches already
    length = lengths.min(axis=1)
    able = np.isfinite(length) & (single | sound) & (touching.sum(axis=1) < 3)
    return np.where(able, np.minimum(length, _LONGEST_M), 0.0)[:, None] * way, np.asarray(able)
