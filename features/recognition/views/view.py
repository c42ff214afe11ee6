"""One view of one object, turned into everything that recognition compares.

One view is enough to store an object (Gatto 2016, 3.2.2). The same call describes what is stored
and what is asked; the graph keeps the bytes, so that an index can be made again from it.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import FloatArray, Frame, Intrinsics, UInt8Array, points_from_depth
from features.recognition.views.appearance import COLOUR_SIZE, appearance_vector, colour_histogram
from features.recognition.views.bspline import (
    ContourSpline,
    SurfaceSpline,
    fit_contour,
    fit_surface,
)
from features.recognition.views.hog import HOG_SIZE, hog_of_crop
from features.recognition.views.picture import take_picture
from features.recognition.views.shape import SHAPE_SIZE, shape_histogram
from features.recognition.views.sift import SiftParams, detect_keypoints

__all__ = ["EXTRACTOR", "MAX_SIDE_PX", "ViewFeatures", "describe_frame", "describe_view"]

EXTRACTOR = "rootsift-240/hsv-hog/1"
"""Name of what :func:`describe_view` computes; features of another name cannot be compared."""

_MIN_MASK_PX = 50

MAX_SIDE_PX = 1_280
"""Of an object's box: keypoints are looked for on 640 px, twice that keeps what they show."""
_MAX_BYTES = 64 * 2**20


@dataclass(frozen=True, eq=False)
class ViewFeatures:
    """Features of one view of an object.

    Parameters
    ----------
    keypoints : (n, 4) float32
        x, y (px of the image), diameter (px), angle (degrees).
    descriptors : (n, 128) uint8
        RootSIFT.
    points3d : (n, 3) float32, m, optical frame of the camera
        NaN where depth is missing.
    colour : (192,) float32
        Square root of the HSV histogram.
    hog : (576,) float32
    mask_px : (4,) float32, px
        Left, top, width and height of the mask's box.
    size_m
        Diagonal of the oriented box of the visible points, m; NaN without depth.
    is_cut
        The mask touches the border of the image: part of the object may be missing.
    contour, surface
        B-splines of the outline and of the depth, when there was enough to fit them.
    extractor
        :data:`EXTRACTOR` of the version that made this.
    picture
        Small picture of the object, as :func:`take_picture` encodes it; empty where it was
        described before pictures were kept.
    shape : (240,) float32 or None
        Of the visible surface, see :func:`shape_histogram`; None without depth, where the object is
        cut, and where it was described before shapes were kept.
    is_mask_guessed
        Nobody said where the object is: it was taken to be in the middle of a photograph.
    """

    keypoints: NDArray[np.float32]
    descriptors: UInt8Array
    points3d: NDArray[np.float32]
    colour: NDArray[np.float32]
    hog: NDArray[np.float32]
    mask_px: NDArray[np.float32]
    size_m: float
    is_cut: bool
    contour: ContourSpline | None = None
    surface: SurfaceSpline | None = None
    extractor: str = EXTRACTOR
    picture: bytes = b""
    shape: NDArray[np.float32] | None = None
    is_mask_guessed: bool = False

    def __post_init__(self) -> None:
        n = len(self.keypoints)
        expected = {
            "keypoints": (n, 4),
            "descriptors": (n, 128),
            "points3d": (n, 3),
            "colour": (COLOUR_SIZE,),
            "hog": (HOG_SIZE,),
            "mask_px": (4,),
        }
        if self.shape is not None:
            expected["shape"] = (SHAPE_SIZE,)
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must have shape {shape}, got {getattr(self, name).shape}")

    def __len__(self) -> int:
        """Return the number of keypoints."""
        return len(self.keypoints)

    @property
    def appearance(self) -> NDArray[np.float32]:
        """Colour and HOG as one unit vector (768,)."""
        return appearance_vector(self.colour, self.hog)

    @property
    def side_px(self) -> float:
        """Longer side of the mask's box, px: what tolerances in the image scale with."""
        return float(self.mask_px[2:].max())

    def to_bytes(self) -> bytes:
        """Return an uncompressed ``.npz``; equal features give equal bytes."""
        arrays: dict[str, Any] = {
            "keypoints": self.keypoints.astype("<f4"),
            "descriptors": self.descriptors,
            "points3d": self.points3d.astype("<f4"),
            "colour": self.colour.astype("<f4"),
            "hog": self.hog.astype("<f4"),
            "mask_px": self.mask_px.astype("<f4"),
            "numbers": np.array([self.size_m, float(self.is_cut)], "<f8"),
            "extractor": np.frombuffer(self.extractor.encode(), np.uint8),
        }
        if self.contour is not None:
            arrays["contour"] = self.contour.control_points.astype("<f4")
        if self.surface is not None:
            arrays["surface"] = self.surface.coefficients.astype("<f4")
            arrays["surface_box"] = np.append(self.surface.box, self.surface.rms_m).astype("<f4")
        if self.picture:
            arrays["picture"] = np.frombuffer(self.picture, np.uint8)
        if self.shape is not None:
            arrays["shape"] = self.shape.astype("<f4")
        if self.is_mask_guessed:
            arrays["mask_guessed"] = np.ones(1, np.uint8)
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        return buffer.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> ViewFeatures:
        """Read what :meth:`to_bytes` wrote; ``ValueError`` says what is wrong with other bytes."""
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                declared = sum(entry.file_size for entry in archive.infolist())
            if declared > _MAX_BYTES:
                raise ValueError(f"view features of {declared} bytes; at most {_MAX_BYTES}")
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                return cls._from_arrays(dict(arrays))
        except (zipfile.BadZipFile, KeyError, OSError, EOFError) as error:
            raise ValueError(f"these bytes are no view features: {error}") from error

    @classmethod
    def _from_arrays(cls, arrays: dict[str, NDArray[Any]]) -> ViewFeatures:
        contour = surface = None
        if "contour" in arrays:
            contour = ContourSpline(arrays["contour"].astype(np.float32))
        if "surface" in arrays:
            *box, rms = arrays["surface_box"].tolist()
            surface = SurfaceSpline(
                arrays["surface"].astype(np.float32), np.array(box, np.float32), rms
            )
        size_m, is_cut = arrays["numbers"].tolist()
        floats = ("keypoints", "points3d", "colour", "hog", "mask_px")
        return cls(
            **{name: arrays[name].astype(np.float32) for name in floats},
            descriptors=arrays["descriptors"].astype(np.uint8),
            size_m=size_m,
            is_cut=bool(is_cut),
            contour=contour,
            surface=surface,
            extractor=arrays["extractor"].tobytes().decode(),
            picture=arrays["picture"].astype(np.uint8).tobytes() if "picture" in arrays else b"",
            shape=arrays["shape"].astype(np.float32) if "shape" in arrays else None,
            is_mask_guessed="mask_guessed" in arrays,
        )


def describe_frame(frame: Frame, params: SiftParams | None = None) -> ViewFeatures:
    """Describe the object that an RGB-D frame, or a crop of one, is about."""
    if frame.rgb is None:
        raise ValueError("the frame has no colour image; recognition needs one")
    camera = frame.intrinsics
    height, width = frame.depth_m.shape
    shifted = Intrinsics(
        width, height, camera.fx, camera.fy, camera.cx - frame.x0, camera.cy - frame.y0
    )
    described = describe_view(frame.rgb, frame.object_mask(), frame.depth_m, shifted, params)
    return replace(described, is_mask_guessed=frame.is_mask_guessed)


def describe_view(
    image: UInt8Array,
    mask: NDArray[np.bool_],
    depth: FloatArray | None = None,
    intrinsics: Intrinsics | None = None,
    params: SiftParams | None = None,
) -> ViewFeatures:
    """Describe the object under a mask.

    Parameters
    ----------
    image : (h, w, 3) uint8 RGB
        Grey (h, w) and RGBA (h, w, 4) are converted.
    mask : (h, w) bool
        Pixels of the object.
    depth : (h, w) float, m, optional
        Along the optical axis; 0 or not finite = missing.
    intrinsics : optional
        Of ``image`` as given (of a crop: with the principal point moved). Needed with ``depth``.

    Notes
    -----
    An object of more than :data:`MAX_SIDE_PX` is described at a fraction of its resolution, which
    bounds time and memory for photographs; places are in pixels of the image as given.

    Raises
    ------
    ValueError
        When the mask is empty, shapes differ, or the image is not 8-bit.

    Examples
    --------
    >>> chess = (np.indices((80, 80)) // 10).sum(axis=0) % 2 * 255
    >>> view = describe_view(chess.astype(np.uint8), np.ones((80, 80), bool))
    >>> view.descriptors.shape[1], view.is_cut
    (128, True)
    """
    rgb = _as_rgb(image)
    mask = np.asarray(mask, dtype=bool)
    if mask.shape != rgb.shape[:2]:
        raise ValueError(f"mask {mask.shape} and image {rgb.shape[:2]} differ in shape")
    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    if width == 0:
        raise ValueError("the mask is empty: there is no object to describe")
    if depth is not None and (intrinsics is None or depth.shape != mask.shape):
        raise ValueError(f"depth needs intrinsics and the mask's shape, got {depth.shape}")
    factor = -(-max(width, height) // MAX_SIDE_PX)
    if factor > 1:
        small = describe_view(*_reduced(rgb, mask, depth, intrinsics, factor), params)
        return replace(
            _enlarged(small, factor),
            mask_px=np.array([left, top, width, height], np.float32),
            is_cut=_is_cut(mask),
            picture=take_picture(rgb, mask),
        )

    grey = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    if np.count_nonzero(mask) < _MIN_MASK_PX:
        keypoints, descriptors = np.empty((0, 4), np.float32), np.empty((0, 128), np.uint8)
    else:
        keypoints, descriptors = detect_keypoints(grey, mask, params)
    points3d = np.full((len(keypoints), 3), np.nan, np.float32)
    size_m, surface, shape = float("nan"), None, None
    if depth is not None and intrinsics is not None:
        inside = np.where(mask, depth, 0).astype(np.float32)
        points3d = _lift(keypoints, inside, intrinsics)
        points = points_from_depth(inside, intrinsics)[mask]
        size_m = _visible_diagonal(points)
        surface = fit_surface(inside, mask)
        shape = None if _is_cut(mask) else shape_histogram(points)
    return ViewFeatures(
        keypoints=keypoints,
        descriptors=descriptors,
        points3d=points3d,
        colour=colour_histogram(rgb, mask),
        hog=hog_of_crop(grey, mask),
        mask_px=np.array([left, top, width, height], np.float32),
        size_m=size_m,
        is_cut=_is_cut(mask),
        contour=fit_contour(mask),
        surface=surface,
        picture=take_picture(rgb, mask),
        shape=shape,
    )


def _is_cut(mask: NDArray[np.bool_]) -> bool:
    return bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())


def _reduced(
    rgb: UInt8Array,
    mask: NDArray[np.bool_],
    depth: FloatArray | None,
    intrinsics: Intrinsics | None,
    factor: int,
) -> tuple[UInt8Array, NDArray[np.bool_], FloatArray | None, Intrinsics | None]:
    """Return image, mask, depth and camera at a whole fraction of the resolution."""
    height, width = (-(-side // factor) for side in mask.shape)
    below, beside = height * factor - mask.shape[0], width * factor - mask.shape[1]
    whole = cv2.copyMakeBorder(rgb, 0, below, 0, beside, cv2.BORDER_REPLICATE)
    image = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    blocks = np.pad(mask, ((0, below), (0, beside))).reshape(height, factor, width, factor)
    small = np.asarray(blocks.any(axis=(1, 3)))
    if depth is None or intrinsics is None:
        return np.asarray(image, dtype=np.uint8), small, None, None
    # Depth is picked, not averaged: between two surfaces there is none.
    padded = np.pad(depth, ((0, below), (0, beside)))
    picked = padded[factor // 2 :: factor, factor // 2 :: factor]
    camera = Intrinsics(
        width, height, intrinsics.fx / factor, intrinsics.fy / factor,
        (intrinsics.cx + 0.5) / factor - 0.5, (intrinsics.cy + 0.5) / factor - 0.5,
    )  # fmt: skip
    return np.asarray(image, dtype=np.uint8), small, picked, camera


def _enlarged(view: ViewFeatures, factor: int) -> ViewFeatures:
    """Return a view's features in pixels of the image before it was reduced."""

    def up(places: NDArray[np.float32]) -> NDArray[np.float32]:
        return ((places + 0.5) * factor - 0.5).astype(np.float32)

    keypoints = view.keypoints.copy()
    keypoints[:, :2] = up(keypoints[:, :2])
    keypoints[:, 2] *= factor
    contour, surface = view.contour, view.surface
    return replace(
        view,
        keypoints=keypoints,
        contour=None if contour is None else ContourSpline(up(contour.control_points)),
        surface=None if surface is None else replace(surface, box=up(surface.box)),
    )


def _as_rgb(image: UInt8Array) -> UInt8Array:
    if image.dtype != np.uint8:
        raise ValueError(f"the image must be 8-bit (uint8), got {image.dtype}")
    if image.ndim == 2:
        return np.repeat(image[:, :, None], 3, axis=2)
    if image.ndim != 3 or image.shape[2] not in (3, 4):
        raise ValueError(f"the image must have shape (h, w), (h, w, 3) or 4, got {image.shape}")
    return np.ascontiguousarray(image[:, :, :3])


def _lift(
    keypoints: NDArray[np.float32], depth_m: NDArray[np.float32], intrinsics: Intrinsics
) -> NDArray[np.float32]:
    """Place keypoints in space by the median depth of the 5 x 5 px around each."""
    height, width = depth_m.shape
    points = np.full((len(keypoints), 3), np.nan, np.float32)
    if len(keypoints) == 0:
        return points
    around = np.arange(-2, 3)
    v = np.clip(np.rint(keypoints[:, 1]).astype(int)[:, None] + around, 0, height - 1)
    u = np.clip(np.rint(keypoints[:, 0]).astype(int)[:, None] + around, 0, width - 1)
    windows = depth_m[v[:, :, None], u[:, None, :]].reshape(len(keypoints), -1)
    measured = np.where(np.isfinite(windows) & (windows > 0), windows, np.nan)
    has_depth = np.isfinite(measured).sum(axis=1) >= 3
    z = np.nanmedian(measured[has_depth], axis=1)
    points[has_depth, 0] = (keypoints[has_depth, 0] - intrinsics.cx) / intrinsics.fx * z
    points[has_depth, 1] = (keypoints[has_depth, 1] - intrinsics.cy) / intrinsics.fy * z
    points[has_depth, 2] = z
    return points


def _visible_diagonal(points: NDArray[np.float32]) -> float:
    """Return the diagonal in m of the box along the principal axes, without the outer 2 %."""
    points = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    if len(points) < 10:
        return float("nan")
    centred = points - np.median(points, axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    low, high = np.percentile(centred @ axes.T, [2, 98], axis=0)
    return float(np.linalg.norm(high - low))
