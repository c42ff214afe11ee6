"""Geometric verification: do the matches of one stored view agree on one movement?

In the image, an affine map (Lowe 2004, 7.5): one match alone proposes a similarity through the
place, size and turn of its two keypoints, the matches that agree refine it to an affine map. With
m matches there are m proposals and no random draw, and a mirror image cannot be proposed. In
space, a rigid movement: :mod:`features.recognition.rigid`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "AffineFit",
    "VerifyParams",
    "count_places",
    "fit_affine",
]

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class VerifyParams:
    """Tolerances, all relative to the size of the object in the image or in space.

    Parameters
    ----------
    affine_tolerance
        Of the longer side of the object in the query image.
    max_turn_deg, max_scale
        How far a match's own turn and size may be from what the affine map does there.
    cells_per_side
        Of the grid over the object in which agreeing matches are counted once a cell: a letter or
        a bar code gives many keypoints in one place, and looks alike on many products.
    min_places
        Fewer places do not verify anything.
    rigid_tolerance, rigid_tolerance_m
        Of the object's visible diagonal, but at least so many m: the noise of depth after the
        median over a keypoint's surroundings.
    rigid_min_side
        Least side of a triple of matches, of the visible diagonal; never asked more than 15 mm.
    rigid_rounds
        Triples drawn for the rigid fit.
    """

    affine_tolerance: float = 0.04
    cells_per_side: int = 16
    max_turn_deg: float = 40.0
    max_scale: float = 2.0
    min_places: int = 4
    rigid_tolerance: float = 0.04
    rigid_tolerance_m: float = 0.002
    rigid_min_side: float = 0.10
    rigid_rounds: int = 200


@dataclass(frozen=True, eq=False)
class AffineFit:
    """An affine map of a stored view's image into the query's, and who agrees with it.

    Parameters
    ----------
    query_from_view : (2, 3) float64, px
    inliers : (m,) bool
    """

    query_from_view: NDArray[np.float64]
    inliers: Mask


def fit_affine(
    query: NDArray[np.float32],
    view: NDArray[np.float32],
    side_px: float,
    params: VerifyParams | None = None,
) -> AffineFit | None:
    """Find the affine map that most matches agree on.

    Parameters
    ----------
    query, view : (m, 4) float32
        Matched keypoints: x, y, diameter in px, angle in degrees.
    side_px
        Longer side of the object in the query image.

    Returns
    -------
    AffineFit or None
        None when fewer than ``min_places`` places agree or the map is degenerate: scale outside
        0.2..5, mirrored, shear over 60 degrees, inliers on one line.

    Examples
    --------
    >>> places = np.array([[0, 0], [50, 4], [9, 40], [44, 38], [20, 21]], np.float32)
    >>> turned = np.hstack([places[:, ::-1] * (1, -1), np.tile((5.0, -90.0), (5, 1))])
    >>> stored = np.hstack([places, np.tile((5.0, 0.0), (5, 1))])
    >>> fit = fit_affine(turned.astype(np.float32), stored.astype(np.float32), 50)
    >>> int(fit.inliers.sum())
    5
    """
    params = params or VerifyParams()
    if len(query) < params.min_places:
        return None
    matrix, inliers = _affine_consensus(
        query.astype(np.float64),
        view.astype(np.float64),
        params.affine_tolerance * side_px,
        np.deg2rad(params.max_turn_deg),
        np.log(params.max_scale),
    )
    fit = AffineFit(matrix, inliers)
    if count_places(
        query[inliers], view[inliers], side_px, params
    ) < params.min_places or not _is_sound(fit, query, view):
        return None
    return fit


def count_places(
    query: NDArray[np.float32],
    view: NDArray[np.float32],
    side_px: float,
    params: VerifyParams | None = None,
) -> int:
    """Return at how many different places matched keypoints (m, 4) lie: how much they say.

    Many query keypoints on one stored spot say no more than one does, and vice versa.
    """
    cell = side_px / (params or VerifyParams()).cells_per_side
    return min(
        len({(int(u), int(v)) for u, v in np.floor(places[:, :2] / size).tolist()})
        for places, size in ((query, cell), (view, 0.5))
    )


def _is_sound(fit: AffineFit, query: NDArray[np.float32], view: NDArray[np.float32]) -> bool:
    (a, b), (c, d) = fit.query_from_view[:, :2].tolist()
    if a * d - b * c <= 0:
        return False
    largest, smallest = _spread(a * a + b * b, c * c + d * d, a * c + b * d)
    if largest > 5 or smallest < 0.2:
        return False
    cosine = (a * b + c * d) / (np.hypot(a, c) * np.hypot(b, d))
    if abs(cosine) > np.sin(np.deg2rad(60)):
        return False
    for places in (query[fit.inliers, :2], view[fit.inliers, :2]):
        x, y = (places - places.mean(axis=0)).astype(np.float64).T
        largest, smallest = _spread(float(x @ x), float(y @ y), float(x @ y))
        if smallest < 0.05 * largest or largest < 1e-6:
            return False
    return True


def _spread(xx: float, yy: float, xy: float) -> tuple[float, float]:
    """Return the singular values of two rows, from their products."""
    middle, swing = 0.5 * (xx + yy), float(np.hypot(0.5 * (xx - yy), xy))
    return float(np.sqrt(middle + swing)), float(np.sqrt(max(middle - swing, 0.0)))


@nb.njit(cache=True, nogil=True)
def _affine_consensus(
    query: NDArray[np.float64],
    view: NDArray[np.float64],
    tolerance: float,
    max_turn: float,
    max_log_scale: float,
) -> tuple[NDArray[np.float64], Mask]:
    m = len(query)
    best_map = np.zeros((2, 3))
    best = np.zeros(m, np.bool_)
    best_count, best_error = 0, np.inf
    seen_fingerprints = {np.uint64(0)}
    turn = np.deg2rad(query[:, 3] - view[:, 3])
    log_scale = np.log(np.maximum(query[:, 2], 1e-3) / np.maximum(view[:, 2], 1e-3))
    for i in range(m):
        s = np.exp(log_scale[i])
        c, d = s * np.cos(turn[i]), s * np.sin(turn[i])
        current = np.array([[c, -d, 0.0], [d, c, 0.0]])
        current[0, 2] = query[i, 0] - c * view[i, 0] + d * view[i, 1]
        current[1, 2] = query[i, 1] - d * view[i, 0] - c * view[i, 1]
        for step in range(4):
            reach = tolerance * (3.0 if step == 0 else 1.5 if step == 1 else 1.0)
            inliers, count, error = _agreeing(
                current, query, view, turn, log_scale, reach, max_turn, max_log_scale
            )
            if step >= 2 and (
                count > best_count or (count == best_count and error < best_error - 1e-9)
            ):
                best_map, best = current, inliers
                best_count, best_error = count, error
            if count < 3 or step == 3:
                break
            # What follows is fixed by who agrees at this step, so it is not followed twice.
            agreement = _fingerprint(inliers, step)
            if agreement in seen_fingerprints:
                break
            seen_fingerprints.add(agreement)
            refined, good = _least_squares_affine(query, view, inliers)
            if not good:
                break
            current = refined
    return best_map, best


@nb.njit(cache=True, nogil=True)
def _fingerprint(inliers: Mask, step: int) -> np.uint64:
    """Return the FNV-1a hash of a mask and a number, 64 bits."""
    prime = np.uint64(1099511628211)
    digest = (np.uint64(14695981039346656037) ^ np.uint64(step + 2)) * prime
    for inlier in inliers:
        digest = (digest ^ np.uint64(inlier)) * prime
    return digest


@nb.njit(cache=True, nogil=True)
def _agreeing(
    candidate: NDArray[np.float64],
    query: NDArray[np.float64],
    view: NDArray[np.float64],
    turn: NDArray[np.float64],
    log_scale: NDArray[np.float64],
    reach: float,
    max_turn: float,
    max_log_scale: float,
) -> tuple[Mask, int, float]:
    a, b, x0 = candidate[0]
    c, d, y0 = candidate[1]
    determinant = a * d - b * c
    m = len(query)
    inliers = np.zeros(m, np.bool_)
    if determinant <= 0:
        return inliers, 0, np.inf
    map_turn = np.arctan2(c - b, a + d)
    map_log_scale = 0.5 * np.log(determinant)
    count, error = 0, 0.0
    for j in range(m):
        ex = a * view[j, 0] + b * view[j, 1] + x0 - query[j, 0]
        ey = c * view[j, 0] + d * view[j, 1] + y0 - query[j, 1]
        square = ex * ex + ey * ey
        if square > reach * reach or abs(log_scale[j] - map_log_scale) > max_log_scale:
            continue
        off = (turn[j] - map_turn + np.pi) % (2 * np.pi) - np.pi
        if abs(off) > max_turn:
            continue
        inliers[j] = True
        count += 1
        error += square
    return inliers, count, error


@nb.njit(cache=True, nogil=True)
def _least_squares_affine(
    query: NDArray[np.float64], view: NDArray[np.float64], inliers: Mask
) -> tuple[NDArray[np.float64], bool]:
    normal = np.zeros((3, 3))
    right = np.zeros((3, 2))
    mean = np.zeros(2)
    count = 0
    for j in range(len(query)):
        if inliers[j]:
            mean += view[j, :2]
            count += 1
    mean /= count
    for j in range(len(query)):
        if inliers[j]:
            x, y = view[j, 0] - mean[0], view[j, 1] - mean[1]
            normal[0, 0] += x * x
            normal[0, 1] += x * y
            normal[0, 2] += x
            normal[1, 1] += y * y
            normal[1, 2] += y
            normal[2, 2] += 1.0
            for k in range(2):
                right[0, k] += x * query[j, k]
                right[1, k] += y * query[j, k]
                right[2, k] += query[j, k]
    normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
    result = np.zeros((2, 3))
    # Three keypoints on a line, or at one place, fix no affine map.
    if abs(normal[0, 0] * normal[1, 1] - normal[0, 1] ** 2) < 1e-3 * normal[0, 0] * normal[1, 1]:
        return result, False
    if normal[0, 0] * normal[1, 1] < 1e-9:
        return result, False
    solution = np.linalg.solve(normal, right)
    for r in range(2):
        result[r, 0] = solution[0, r]
        result[r, 1] = solution[1, r]
        result[r, 2] = solution[2, r] - solution[0, r] * mean[0] - solution[1, r] * mean[1]
    return result, True
