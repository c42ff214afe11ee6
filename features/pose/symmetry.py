"""Turns that leave an object's surface as it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.geometry import FloatArray
from features.pose.rotations import rotation_about

__all__ = ["find_symmetries"]

_TURNS_DEG = (60, 72, 90, 120, 144, 180, 216, 240, 270, 288, 300)
# A turn by 5 degrees of anything smooth passes; small angles are therefore never tested.
_CONTINUOUS_DEG = tuple(range(30, 331, 15))
_STEP_DEG = 5
_FEW, _FAR_OFF = 100, 1.5
_SLACK = 1.1
_TOLERANCE = 0.002


def find_symmetries(
    surface: FloatArray, probes: FloatArray, diameter: float, noise_m: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the turns (k, 3, 3) about the origin, and the axes (j, 3) of all turns.

    Tried are the axes of the object's frame and its principal axes.

    Parameters
    ----------
    surface : (n, 3) float, m
        Samples, the origin in the middle of their box.
    probes : (m, 3) float, m
        Other samples of the same surface.
    diameter
        Of the box, m.
    noise_m
        By so much places may be off: a turn that changes less on average is one.
    """
    # Two samplings of one surface never coincide: turned probes may be as far from the samples as
    # unturned ones are.
    tree = cKDTree(surface)
    bound = _SLACK * float(tree.query(probes)[0].mean())
    bound += _TOLERANCE * diameter + noise_m

    def holds(turn: NDArray[np.float64]) -> bool:
        # Most turns are far off, which a few probes tell.
        few = probes[:: max(len(probes) // _FEW, 1)]
        if float(tree.query(few @ turn.T)[0].mean()) > _FAR_OFF * bound:
            return False
        return float(tree.query(probes @ turn.T)[0].mean()) < bound

    turns = [np.eye(3)]
    whole: list[NDArray[np.float64]] = []
    for axis in _axes(probes):
        if all(holds(rotation_about(axis, np.deg2rad(a))) for a in _CONTINUOUS_DEG):
            whole.append(axis)
            angles: tuple[int, ...] = tuple(range(_STEP_DEG, 360, _STEP_DEG))
            turns += [rotation_about(axis, np.deg2rad(a)) for a in angles]
            continue
        turned = (rotation_about(axis, np.deg2rad(a)) for a in _TURNS_DEG)
        turns += [turn for turn in turned if holds(turn)]
    turns = _distinct(turns + _products(turns, whole, holds))
    return np.array(turns), np.array(whole).reshape(-1, 3)


def _axes(probes: FloatArray) -> list[NDArray[np.float64]]:
    _, _, principal = np.linalg.svd(probes - probes.mean(axis=0), full_matrices=False)
    # A principal axis near one of the frame would give each turn twice, a few degrees apart.
    axes = list(np.eye(3))
    for axis in principal:
        if max(abs(float(axis @ other)) for other in np.eye(3)) < np.cos(np.deg2rad(4)):
            axes.append(axis)
    return axes


def _products(
    turns: list[NDArray[np.float64]],
    whole: list[NDArray[np.float64]],
    holds: Callable[[NDArray[np.float64]], bool],
) -> list[NDArray[np.float64]]:
    """Return products of two turns that hold as well: flips of a cylinder, turns of a cube."""
    if whole:
        flips = [
            turn for turn in turns[1:] if abs(np.trace(turn) + 1) < 1e-6  # by 180 degrees
            and any(float(axis @ turn @ axis) < -0.99 for axis in whole)
        ]  # fmt: skip
        # One flip is enough: the others are its products with turns about the axis.
        about = [t for t in turns if any(float(axis @ t @ axis) > 0.9999 for axis in whole)]
        return [flip @ turn for flip in flips[:1] for turn in about]
    few = turns[: len(_TURNS_DEG) * 3]
    products = [a @ b for a in few for b in few]
    products = [turn for turn in _distinct(products) if holds(turn)]
    # No body but the round ones has more than the 60 turns of the icosahedron; more is noise.
    return products if len(products) <= 60 else []


def _distinct(turns: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    distinct: list[NDArray[np.float64]] = []
    for turn in turns:
        if all(np.trace(turn.T @ other) < 1 + 2 * np.cos(np.deg2rad(2)) for other in distinct):
            distinct.append(turn)
    return distinct
