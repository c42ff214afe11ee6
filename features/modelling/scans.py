"""Scans: what the views of a model showed, kept to improve their movements together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.geometry import Frame
from features.modelling.fusion import fused, oriented_points

__all__ = ["Scan", "fused_scans", "scans_from_arrays", "scans_to_arrays"]

_PER_M = 2.0**14
"""Places are kept in steps of 0.06 mm, a thirtieth of the noise of depth."""
_PER_UNIT = 127.0


@dataclass(frozen=True, eq=False)
class Scan:
    """Oriented points of one view, and where its camera was told to be.

    Numbers are rounded when it is made, so that a scan is the same after it was stored.

    Parameters
    ----------
    rows : (n, 6) float32
        Places (m, camera) and normals towards the camera.
    colours : (n, 3) uint8 RGB
    trust : (n,) float32
        See :func:`features.modelling.fusion.oriented_points`.
    prior_pose : (4, 4) float64
        ``object_from_camera`` as it was known before registration.
    pivot : (3,) float64, m, object frame
        Point about which an error of ``prior_pose`` turns.
    is_measured
        Whether ``prior_pose`` was measured, rather than estimated from what the view shows.
    """

    rows: NDArray[np.float32]
    colours: NDArray[np.uint8]
    trust: NDArray[np.float32]
    prior_pose: NDArray[np.float64]
    pivot: NDArray[np.float64]
    is_measured: bool = False

    @classmethod
    def of(cls, frame: Frame) -> Scan:
        """Return what a frame shows of its object, for a camera at the object's origin."""
        rows, colours, trust = oriented_points(frame)
        rounded = np.hstack(
            [np.rint(rows[:, :3] * _PER_M) / _PER_M, np.rint(rows[:, 3:] * _PER_UNIT) / _PER_UNIT]
        )
        coarse = trust.astype(np.float16).astype(np.float32)
        return cls(rounded.astype(np.float32), colours, coarse, np.eye(4), np.zeros(3))

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.rows)

    @cached_property
    def tree(self) -> cKDTree:
        """Places in the camera's frame, which no improvement of the movement changes."""
        return cKDTree(self.rows[:, :3])

    def moved(self, object_from_camera: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return places and normals (n, 6) in the object's frame."""
        turn, shift = object_from_camera[:3, :3], object_from_camera[:3, 3]
        return np.hstack([self.rows[:, :3] @ turn.T + shift, self.rows[:, 3:] @ turn.T])


def fused_scans(
    scans: Sequence[Scan], poses: Sequence[NDArray[np.float64]]
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    """Return the cloud, colours and weights of scans at ``object_from_camera`` (4, 4) each."""
    return fused(
        np.vstack([scan.moved(pose) for scan, pose in zip(scans, poses, strict=True)]),
        np.vstack([scan.colours for scan in scans]),
        np.concatenate([scan.trust for scan in scans]).astype(np.float64),
    )


def scans_to_arrays(scans: Sequence[Scan]) -> dict[str, Any]:
    """Return arrays from which :func:`scans_from_arrays` makes the same scans."""
    if not scans:
        return {}
    rows = np.vstack([scan.rows for scan in scans]).astype(np.float64)
    return {
        "scan_sizes": np.array([len(scan) for scan in scans], "<i4"),
        "scan_places": np.rint(rows[:, :3] * _PER_M).astype("<i4"),
        "scan_normals": np.rint(rows[:, 3:] * _PER_UNIT).astype(np.int8),
        "scan_colours": np.vstack([scan.colours for scan in scans]),
        "scan_trust": np.concatenate([scan.trust for scan in scans]).astype("<f2"),
        "scan_told": np.array([scan.prior_pose for scan in scans], "<f8"),
        "scan_pivots": np.array([scan.pivot for scan in scans], "<f8"),
        "scan_measured": np.array([scan.is_measured for scan in scans]),
    }


def scans_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> tuple[Scan, ...]:
    """Return the scans among the arrays of a model; none if it was stored without."""
    if "scan_sizes" not in arrays:
        return ()
    cuts = np.cumsum(arrays["scan_sizes"])[:-1]
    rows = np.hstack([arrays["scan_places"] / _PER_M, arrays["scan_normals"] / _PER_UNIT])
    columns = (
        np.split(rows.astype(np.float32), cuts),
        np.split(arrays["scan_colours"], cuts),
        np.split(arrays["scan_trust"].astype(np.float32), cuts),
        arrays["scan_told"].astype(np.float64),
        arrays["scan_pivots"].astype(np.float64),
        arrays["scan_measured"].tolist(),
    )
    return tuple(Scan(*fields) for fields in zip(*columns, strict=True))
