"""Chance that grasps hold what was seen from one side, over the shapes that it may have.

Each draw takes one sample of the shape and one error of the pose. The pads close on the sample as
they do on a mesh, so what holds there holds here: patches, levers and taper
(:mod:`grasp.spatial.scoring.holding`). All candidates see the same draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from grasp.arrays import FloatArray, IntArray
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.clouds.shape_samples import ShapeSamples, shape_value
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.scoring.confidence import PoseNoise
from grasp.spatial.scoring.holding import CARRY_G, LIFT_G, demands, hold_shares
from grasp.spatial.scoring.pads import PadContacts, pad_grid
from grasp.spatial.scoring.promises import Promises

__all__ = ["with_shape_chance"]

_DENSITY, _MASS_KG = 700.0, (0.03, 1.0)
_COMPLIANCE_M, _IN_WALL_M = 0.002, 0.001
_COLUMNS = 16
_TOUCHING, _UNSURE = 0.2, 0.4
_STRIDE, _LEAST_M, _THIN_M = 0.8, 0.001, 1e-4
_PROBE = 0.7
"""Half of the way over which a slope is taken, in cells."""


def with_shape_chance(
    candidates: Sequence[GraspCandidate],
    shapes: ShapeSamples,
    gripper: ParallelGripper,
    mass: float | None = None,
    noise: PoseNoise | None = None,
    *,
    draws: int = 72,
    seed: int = 0,
    promises: Promises | None = None,
) -> list[GraspCandidate]:
    """Return the candidates with ``lift``, ``carry``, ``load`` and ``lever`` as scores.

    Parameters
    ----------
    shapes
        In the candidates' frame.
    mass
        Of the object, kg; None = that of wood, for each sample by its volume.
    noise
        Of the pose, about the gripper's centre; None = 4 mm and .1 rad.
    draws
        Each of one sample and one error of the pose.
    promises
        Of the hand; None = those of a hand without outcomes.

    Notes
    -----
    A draw in which the open hand is in the way of the sample counts a fifth, and a grasp
    whose ``confidence``, that of closing on the one guess of the shape, is 0 two fifths.
    """
    if not candidates:
        return []
    noise, promises = noise or PoseNoise(), promises or Promises.by(gripper)
    poses = np.stack([c.frame_from_gripper for c in candidates])
    openings = np.array(
        [gripper.max_opening if c.opening is None else c.opening for c in candidates]
    )
    which = np.arange(draws) % len(shapes)
    contacts, touched = _closed(shapes, which, poses, openings, gripper, noise, draws, seed)
    weight = np.full(draws, mass) if mass is not None else (
        np.clip(_DENSITY * shapes.volume, *_MASS_KG)[which]
    )  # fmt: skip
    demand = demands(contacts, gripper, 1.0)
    demand = replace(demand, force=demand.force * weight, torque=demand.torque * weight)
    clear = np.where(touched, _TOUCHING, 1.0)
    held = {name: hold_shares(contacts, demand, g) * clear
            for name, g in (("lift", LIFT_G), ("carry", CARRY_G))}  # fmt: skip
    com = shapes.com[which].mean(axis=0)
    scored = []
    for i, candidate in enumerate(candidates):
        sure = _UNSURE + (1 - _UNSURE) * candidate.scores.get("confidence", 1.0)
        scores = {name: float(share[i].mean()) * sure for name, share in held.items()}
        scores["load"] = float(demand.force[i].mean())
        scores |= promises.of(scores)
        middle = candidate.centre if candidate.contacts is None else candidate.contacts.mean(axis=0)
        scores["lever"] = float(np.linalg.norm(middle - com))
        scored.append(replace(candidate, scores={**candidate.scores, **scores}))
    return scored


def _closed(
    shapes: ShapeSamples, which: IntArray, poses: FloatArray, openings: FloatArray,
    gripper: ParallelGripper, noise: PoseNoise, draws: int, seed: int,
) -> tuple[PadContacts, NDArray[np.bool_]]:  # fmt: skip
    """Return what the pads meet in each draw, and whether the open hand is in its way, (c, K)."""
    out = np.zeros((len(poses), draws, _COLUMNS))
    probes = np.stack([_probes(gripper, float(opening)) for opening in openings])
    _press(
        shapes.hull, shapes.skin, shapes.ripple, shapes.images, shapes.cell,
        shapes.cell / shapes.ripple_cell, shapes.frame, shapes.com, which,
        np.ascontiguousarray(poses), noise.transforms(draws, seed), noise.covariance is not None,
        openings, pad_grid(gripper), probes, _COMPLIANCE_M, out,
    )  # fmt: skip
    normals = out[..., 9:15].reshape(*out.shape[:2], 2, 3)
    contacts = PadContacts(
        out[..., 0] > 0, normals, out[..., 2:4], out[..., 4:6], out[..., 6:9], out[..., 1]
    )
    return contacts, out[..., 15] > 0


def _probes(gripper: ParallelGripper, opening: float) -> FloatArray:
    """Return points (n, 3), m, of the open fingers and the palm in the gripper frame."""
    half, wide = opening / 2, gripper.finger_width / 2
    root = gripper.fingertip - gripper.finger_length
    finger = np.stack(np.meshgrid(
        [half, half + gripper.thickness / 2, half + gripper.thickness], [-wide, 0.0, wide],
        np.linspace(gripper.fingertip, root, 5), indexing="ij",
    ), axis=-1).reshape(-1, 3)  # fmt: skip
    palm = np.stack(np.meshgrid(
        np.linspace(-half, half, 5), [-wide, 0.0, wide], [root], indexing="ij"
    ), axis=-1).reshape(-1, 3)  # fmt: skip
    return np.concatenate([finger * (-1, 1, 1), finger, palm])


@njit(cache=True, nogil=True)
def _at(shape, x, y, z):  # type: ignore[no-untyped-def]
    hull, skin, ripple, image, cell, finer = shape
    return shape_value(hull, skin, ripple, image, cell, finer, x, y, z)


@njit(cache=True, nogil=True)
def _first(shape, g, x, y, z, sign, half):  # type: ignore[no-untyped-def]
    """Return where a jaw that comes from ``-half`` along ``sign`` times x meets a sample, m; 2 half
    where it does not."""
    t, last, before = -half, -half, np.inf
    while t < half:
        s = sign * t
        f = _at(
            shape, x + s * g[0, 0], y + s * g[1, 0], z + s * g[2, 0]
        )  # fmt: skip
        if f <= 0.0:
            if before < np.inf:
                t -= (t - last) * f / (f - before)
            return t
        before, last = f, t
        # The distance is a guess, but a good one: never a stride much longer than it.
        t += max(_STRIDE * f, _LEAST_M)
    return 2 * half


@njit(cache=True, nogil=True)
def _slope(shape, x, y, z, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` (3,) with the unit normal of a sample at a place, in the grid's axes."""
    out[0] = _at(shape, x + _PROBE, y, z) - _at(shape, x - _PROBE, y, z)
    out[1] = _at(shape, x, y + _PROBE, z) - _at(shape, x, y - _PROBE, z)
    out[2] = _at(shape, x, y, z + _PROBE) - _at(shape, x, y, z - _PROBE)
    length = max(np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2), 1e-12)
    for i in range(3):
        out[i] /= length


@njit(cache=True, nogil=True)
def _is_inside(shape, g, probes):  # type: ignore[no-untyped-def]
    """Tell whether a point of the hand is in a sample, by more than its surface is known to."""
    for x, y, z in probes:
        f = _at(
            shape,
            g[0, 0] * x + g[0, 1] * y + g[0, 2] * z + g[0, 3],
            g[1, 0] * x + g[1, 1] * y + g[1, 2] * z + g[1, 3],
            g[2, 0] * x + g[2, 1] * y + g[2, 2] * z + g[2, 3],
        )
        if f < -_IN_WALL_M:
            return True
    return False


@njit(cache=True, nogil=True)
def _times(a, b, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` (3, 4) with the product of two transforms."""
    for i in range(3):
        for j in range(4):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
        out[i, 3] += a[i, 3]


@njit(cache=True, nogil=True)
def _patch(jaw, places, at, normals, first, last, soft, turn, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` (16,) with one pad's patch; return its middle along the gripper's y and z."""
    total, sy, sz, syy = 0.0, 0.0, 0.0, 0.0
    normal = np.zeros(3)
    for r in range(len(places)):
        gap = at[r, 0] - first if jaw == 0 else last - at[r, 1]
        w = 1.0 - gap / soft
        if not w > 0.0:
            continue
        y, z = places[r]
        total += w
        sy += w * y
        sz += w * z
        syy += w * (y * y + z * z)
        for i in range(3):
            normal[i] += w * normals[r, jaw, i]
    length = max(np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2), 1e-12)
    for i in range(3):
        along = normal[0] * turn[0, i] + normal[1] * turn[1, i] + normal[2] * turn[2, i]
        out[9 + 3 * jaw + i] = along / length
    sy, sz = sy / total, sz / total
    out[2 + jaw] = np.sqrt(max(syy / total - sy * sy - sz * sz, 0.0))
    out[4 + jaw] = total
    return sy, sz


@njit(cache=True, nogil=True)
def _press(  # type: ignore[no-untyped-def]
    hull,
    skin,
    ripple,
    images,
    cell,
    finer,
    frame,
    com,
    which,
    poses,
    errors,
    in_object,
    openings,
    places,
    probes,
    soft,
    out,
):
    """Fill ``out`` (c, K, 16): what :class:`PadContacts` holds, and whether a probe is inside."""
    at, normals = np.empty((len(places), 2)), np.zeros((len(places), 2, 3))
    m, g = np.empty((3, 4)), np.empty((3, 4))
    for c in range(len(poses)):
        half = openings[c] / 2
        for k in range(len(errors)):
            s = which[k]
            shape = (hull, skin, ripple[s], images[s], cell, finer)
            if in_object:
                _times(errors[k], poses[c], m)
            else:
                _times(poses[c], errors[k], m)
            _times(frame, m, g)
            row = out[c, k]
            row[15] = _is_inside(shape, g, probes[c])
            first, last = np.inf, -np.inf
            for r in range(len(places)):
                y, z = places[r]
                ox = g[0, 3] + y * g[0, 1] + z * g[0, 2]
                oy = g[1, 3] + y * g[1, 1] + z * g[1, 2]
                oz = g[2, 3] + y * g[2, 1] + z * g[2, 2]
                at[r] = np.nan
                left = _first(shape, g, ox, oy, oz, 1.0, half)
                if left > half:
                    continue
                at[r, 0], at[r, 1] = left, -_first(shape, g, ox, oy, oz, -1.0, half)
                first, last = min(first, at[r, 0]), max(last, at[r, 1])
            if not last - first > _THIN_M:
                continue
            for r in range(len(places)):
                for jaw in range(2):
                    gap = at[r, 0] - first if jaw == 0 else last - at[r, 1]
                    if gap < soft:
                        y, z, t = places[r, 0], places[r, 1], at[r, jaw]
                        _slope(
                            shape,
                            g[0, 3] + t * g[0, 0] + y * g[0, 1] + z * g[0, 2],
                            g[1, 3] + t * g[1, 0] + y * g[1, 1] + z * g[1, 2],
                            g[2, 3] + t * g[2, 0] + y * g[2, 1] + z * g[2, 2],
                            normals[r, jaw],
                        )
            row[0], row[1] = 1.0, last - first
            # The grid's axes are the cloud's, turned and counted in cells.
            turn = g[:, :3] * cell
            ly, lz = _patch(0, places, at, normals, first, last, soft, turn, row)
            ry, rz = _patch(1, places, at, normals, first, last, soft, turn, row)
            middle = ((first + last) / 2, (ly + ry) / 2, (lz + rz) / 2)
            for j in range(3):
                away = 0.0
                for i in range(3):
                    away += (com[s, i] - m[i, 3]) * m[i, j]
                row[6 + j] = away - middle[j]
