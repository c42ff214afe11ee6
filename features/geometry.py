"""Pinhole cameras and RGB-D frames: the types that every part of perception shares.

Frames are named after REP 103: the *optical* frame has x to the right, y down, z forward.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Float64Array",
    "FloatArray",
    "Frame",
    "Intrinsics",
    "UInt8Array",
    "finite_depth",
    "look_at",
    "points_from_depth",
    "pose_matrix",
    "transform",
]

FloatArray = NDArray[np.floating[Any]]
Float64Array = NDArray[np.float64]
UInt8Array = NDArray[np.uint8]


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; pixel centres lie at integer coordinates.

    Parameters
    ----------
    width, height
        Size of the full image, px.
    fx, fy, cx, cy
        Focal lengths and principal point, px.

    Examples
    --------
    >>> Intrinsics.from_fov(640, 480, 1.2).fx.__round__(2)
    467.74
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        numbers = (self.fx, self.fy, self.cx, self.cy)
        if not all(np.isfinite(n) for n in numbers) or self.fx <= 0 or self.fy <= 0:
            raise ValueError(
                f"intrinsics must be finite with fx, fy > 0 px, got fx={self.fx} fy={self.fy} "
                f"cx={self.cx} cy={self.cy}"
            )
        if self.width < 1 or self.height < 1:
            raise ValueError(f"image size must be positive, got {self.width}x{self.height}")

    @classmethod
    def from_fov(cls, width: int, height: int, horizontal_fov_rad: float) -> Intrinsics:
        """Return the square-pixel camera of a horizontal field of view in rad, 0..pi."""
        if not 0 < horizontal_fov_rad < np.pi:
            raise ValueError(f"a field of view lies in 0..pi rad, got {horizontal_fov_rad}")
        focal = width / 2 / float(np.tan(horizontal_fov_rad / 2))
        return cls(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def finite_depth(depth_m: FloatArray) -> NDArray[np.float32]:
    """Return a depth image (h, w), m, with 0 where nothing was measured: not finite, or negative.

    Cameras mark what is too near or too far by -inf and inf (REP 117), some what is missing by -1.

    Examples
    --------
    >>> finite_depth(np.array([[0.5, np.inf, np.nan, -1.0]])).tolist()
    [[0.5, 0.0, 0.0, 0.0]]
    """
    return np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0).astype(np.float32)


def points_from_depth(
    depth_m: FloatArray, intrinsics: Intrinsics, x0: int = 0, y0: int = 0
) -> NDArray[np.float32]:
    """Return the organised cloud of a depth image.

    Parameters
    ----------
    depth_m : (h, w) float, m
        Depth along the optical axis; 0 or not finite = missing.
    intrinsics
        Of the full image.
    x0, y0
        Pixel of the full image at which a cropped ``depth_m`` begins.

    Returns
    -------
    (h, w, 3) float32, m, optical frame
        NaN where depth is missing.
    """
    if depth_m.ndim != 2:
        raise ValueError(f"expected a depth image of shape (h, w) in m, got {depth_m.shape}")
    height, width = depth_m.shape
    z = np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, np.nan).astype(np.float32)
    u = (np.arange(x0, x0 + width, dtype=np.float32) - intrinsics.cx) / intrinsics.fx
    v = (np.arange(y0, y0 + height, dtype=np.float32) - intrinsics.cy) / intrinsics.fy
    return np.stack([u[None, :] * z, v[:, None] * z, z], axis=-1).astype(np.float32)


def look_at(eye: FloatArray, target: FloatArray) -> NDArray[np.float64]:
    """Return ``world_from_camera`` (4, 4) of an optical frame at ``eye`` that looks at a point.

    Parameters
    ----------
    eye, target : (3,), m
        World frame, z up. Straight up or down, the world's x is to the right.

    Raises
    ------
    ValueError
        When both are one point.

    Examples
    --------
    >>> look_at(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0]))[:3, 2].tolist()
    [1.0, 0.0, 0.0]
    """
    if np.array_equal(target, eye):
        raise ValueError(f"a camera cannot look at its own place, got {eye} twice")
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0]) if forward[:2].any() else np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(forward, right), forward
    pose[:3, 3] = eye
    return pose


def pose_matrix(rotation: ArrayLike, position: ArrayLike) -> Float64Array:
    """Return the (4, 4) matrix of a rotation (3, 3) and a position (3,), m."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def transform(target_from_source: FloatArray, points: FloatArray) -> FloatArray:
    """Apply a (4, 4) rigid transform to points (..., 3), m; NaN stays NaN."""
    rotated: FloatArray = points @ target_from_source[:3, :3].T + target_from_source[:3, 3]
    return rotated


@dataclass(frozen=True)
class Frame:
    """One RGB-D frame, or a crop of one, in the optical frame of its camera.

    Parameters
    ----------
    depth_m : (h, w) float32, m
        0 = missing.
    intrinsics
        Of the full image; the crop begins at pixel (``x0``, ``y0``) of it.
    rgb : (h, w, 3) uint8 or None
    mask : (h, w) bool or None
        Pixels of the object that the frame is about; None = every pixel with depth.
    frame_id
        Name of the frame the points are in (tf).
    stamp_s
        Time of capture, s since the epoch.
    is_mask_guessed
        Nobody said where the object is: it was taken to be in the middle.
    doubts
        Sentences about what of its numbers is doubtful, such as their unit; nothing was changed.
    """

    depth_m: NDArray[np.float32]
    intrinsics: Intrinsics
    rgb: UInt8Array | None = None
    mask: NDArray[np.bool_] | None = None
    x0: int = 0
    y0: int = 0
    frame_id: str = ""
    stamp_s: float = 0.0
    is_mask_guessed: bool = False
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.depth_m.ndim != 2:
            raise ValueError(f"depth_m must have shape (h, w), got {self.depth_m.shape}")
        shape = self.depth_m.shape
        if self.rgb is not None and self.rgb.shape != (*shape, 3):
            raise ValueError(f"rgb must have shape {(*shape, 3)}, got {self.rgb.shape}")
        if self.mask is not None and self.mask.shape != shape:
            raise ValueError(f"mask must have shape {shape}, got {self.mask.shape}")

    def points(self) -> NDArray[np.float32]:
        """Return the organised cloud (h, w, 3), m, optical frame, NaN where missing."""
        return points_from_depth(self.depth_m, self.intrinsics, self.x0, self.y0)

    def object_mask(self) -> NDArray[np.bool_]:
        """Return the mask, or every pixel with depth when there is none."""
        return finite_depth(self.depth_m) > 0 if self.mask is None else self.mask

    def crop(self, mask: NDArray[np.bool_], margin_px: int = 12) -> Frame:
        """Cut out the object under ``mask`` with some context; depth outside becomes 0."""
        rows, columns = np.nonzero(mask)
        if len(rows) == 0:
            raise ValueError("the mask is empty: nothing to cut out")
        top, left = max(int(rows.min()) - margin_px, 0), max(int(columns.min()) - margin_px, 0)
        bottom = min(int(rows.max()) + margin_px + 1, mask.shape[0])
        right = min(int(columns.max()) + margin_px + 1, mask.shape[1])
        box = (slice(top, bottom), slice(left, right))
        cut = mask[box]
        return Frame(
            depth_m=np.where(cut, self.depth_m[box], np.float32(0)),
            intrinsics=self.intrinsics,
            rgb=None if self.rgb is None else self.rgb[box].copy(),
            mask=cut.copy(),
            x0=self.x0 + left,
            y0=self.y0 + top,
            frame_id=self.frame_id,
            stamp_s=self.stamp_s,
            is_mask_guessed=self.is_mask_guessed,
        )
