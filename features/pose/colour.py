"""Colours of posed samples compared with the image, to tell apart what shape cannot.

A cube fits in 24 ways and a marker lies either way round; the print differs. White balance is taken
out by what all samples have in common, brightness by what each side has, so that light and shade do
not decide.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import Float64Array, UInt8Array

__all__ = ["ColourChoice", "choose_by_colour", "colour_misfits"]

_MAX_SAMPLES = 900
_MIN_SEEN = 40
_MIN_FACING = 0.25
_SAME_M = 0.008
_MAX_LIGHT, _MAX_TINT, _MAX_GAIN = 30.0, 8.0, 2.0
_MAX_APART = 40.0
_MIN_LEAD, _LEAD_SHARE = 2.0, 0.15
_SAME_RAD = np.deg2rad(15.0)


def colour_misfits(
    samples: NDArray[np.float32],
    colours: UInt8Array,
    poses: tuple[Float64Array, Float64Array],
    depth_m: NDArray[np.float32],
    rgb: UInt8Array,
    camera: tuple[float, float, float, float],
) -> Float64Array:
    """Return the mean distance (k,) of colours in CIELab; NaN where too little is seen.

    Parameters
    ----------
    samples : (n, 6) float32, m
        Places about the model's centre, and normals.
    colours : (n, 3) uint8 RGB
        Of the samples.
    poses
        Rotations (k, 3, 3) and translations (k, 3), m, of the centred model in the camera.
    depth_m : (h, w) float32, m
        A sample is seen where it was measured, within 8 mm.
    rgb : (h, w, 3) uint8
    camera
        fx, fy, cx, cy of the image, px.
    """
    few = np.random.default_rng(0).permutation(len(samples))[:_MAX_SAMPLES]
    seen_lab = cv2.cvtColor(colours[few][None], cv2.COLOR_RGB2Lab)[0].astype(np.float64)
    usual = colours[few].sum(axis=1).astype(np.float64)
    places, normals = samples[few, :3].astype(np.float64), samples[few, 3:].astype(np.float64)
    fx, fy, cx, cy = camera
    height, width = depth_m.shape
    misfits = np.full(len(poses[0]), np.nan)
    for k, (rotation, translation) in enumerate(zip(*poses, strict=True)):
        here = places @ rotation.T + translation
        facing = -np.einsum("ni,ni->n", normals @ rotation.T, here)
        z = here[:, 2]
        seen = (facing > _MIN_FACING * np.linalg.norm(here, axis=1)) & (z > 0.01)
        z = np.where(z > 0.01, z, 1.0)
        u = np.floor(fx * here[:, 0] / z + cx + 0.5).astype(np.int64)
        v = np.floor(fy * here[:, 1] / z + cy + 0.5).astype(np.int64)
        seen &= (u >= 0) & (v >= 0) & (u < width) & (v < height)
        u, v = np.where(seen, u, 0), np.where(seen, v, 0)
        seen &= np.abs(depth_m[v, u] - z) < _SAME_M
        if np.count_nonzero(seen) < _MIN_SEEN:
            continue
        inks = rgb[v[seen], u[seen]]
        light = np.median(inks.sum(axis=1)) / max(float(np.median(usual[seen])), 1.0)
        inks = np.clip(inks / np.clip(light, 1 / _MAX_GAIN, _MAX_GAIN), 0, 255).astype(np.uint8)
        apart = cv2.cvtColor(inks[None], cv2.COLOR_RGB2Lab)[0].astype(np.float64) - seen_lab[seen]
        tint = np.median(apart[:, 1:], axis=0)
        apart[:, 1:] -= np.clip(tint, -_MAX_TINT, _MAX_TINT)
        apart[:, 0] -= _light(apart[:, 0], normals[seen] @ rotation.T)
        misfits[k] = np.minimum(np.linalg.norm(apart, axis=1), _MAX_APART).mean()
    return misfits


def _light(apart: Float64Array, normals: Float64Array) -> Float64Array:
    """Return the difference of lightness (n,) that sides of one direction have in common."""
    _, side = np.unique(np.rint(1.5 * normals), axis=0, return_inverse=True)
    side = side.ravel()
    light = np.empty(len(apart))
    for number in range(int(side.max()) + 1):
        mine = side == number
        light[mine] = np.median(apart[mine])
    return np.clip(light, -_MAX_LIGHT, _MAX_LIGHT)


@dataclass(frozen=True)
class ColourChoice:
    """The evidence of colours about candidates that shape cannot tell apart.

    Parameters
    ----------
    candidate, variant
        The one that is chosen; candidate 0 and variant 0 where colours do not tell.
    rivals
        Number of other candidates whose colours fit as well.
    is_decided
        Whether the variant is clear of all others of its candidate.
    """

    candidate: int
    variant: int
    rivals: int
    is_decided: bool


def choose_by_colour(misfits: Float64Array, rotations: Float64Array) -> ColourChoice:
    """Choose among candidates (c), each in the variants (s) that a symmetry of its shape allows.

    Parameters
    ----------
    misfits : (c, s) float64
        Of :func:`colour_misfits`; NaN = not seen.
    rotations : (s, 3, 3) float64
        Of the variants; the first is the identity.

    Examples
    --------
    >>> turns = np.stack([np.eye(3), np.diag([-1.0, -1.0, 1.0])])
    >>> choose_by_colour(np.array([[21.0, 4.0]]), turns)
    ColourChoice(candidate=0, variant=1, rivals=0, is_decided=True)
    >>> choose_by_colour(np.array([[5.0, 4.5]]), turns).is_decided
    False
    """
    finite = np.where(np.isfinite(misfits), misfits, np.inf)
    least = finite.min(axis=1)
    if not np.isfinite(least).any():
        return ColourChoice(0, 0, len(misfits) - 1, False)
    bound = _clear_of(float(least.min()))
    alike = np.flatnonzero((least <= bound) | ~np.isfinite(least))
    candidate = 0 if 0 in alike else int(least.argmin())
    row = finite[candidate]
    variant = int(row.argmin())
    cosines = (np.einsum("sij,ij->s", rotations, rotations[variant]) - 1) / 2
    others = row[(cosines < np.cos(_SAME_RAD)) & np.isfinite(row)]
    decided = bool(len(others)) and bool(others.min() > _clear_of(float(row[variant])))
    # Of one painted side nobody can tell the quarter turns, yet that side is not another.
    unchanged = 0 if row[0] <= _clear_of(float(row[variant])) else variant
    rivals = len(alike) - int(candidate in alike)
    return ColourChoice(candidate, variant if decided else unchanged, rivals, decided)


def _clear_of(misfit: float) -> float:
    """Return the misfit above which another is clearly worse."""
    return _MIN_LEAD + (1 + _LEAD_SHARE) * misfit
