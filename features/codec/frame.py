"""RGB-D frames and crops: exact depth as PNG, colour as JPEG.

Depth is stored in steps of 1 mm when it is measured in whole ones or goes beyond 6.5 m, else of
0.1 mm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.codec.container import (
    CODEC_PNG,
    FLAG_COLOUR,
    FLAG_MASK,
    KIND_FRAME,
    SECTION_COLOUR,
    SECTION_DEPTH,
    SECTION_MASK,
    Container,
    Section,
    pack,
)
from features.codec.image import decode_image, jpeg, png
from features.codec.limits import CloudFormatError, Limits
from features.geometry import Frame, Intrinsics

__all__ = ["encode_frame", "read_frame"]

_FINE_M, _COARSE_M = 1e-4, 1e-3
_MAX_STEPS = 65_535


def encode_frame(frame: Frame, quality: int = 90) -> bytes:
    """Return a frame, or a crop of one, as a container.

    Parameters
    ----------
    frame
        Depth in m, 0 or not finite = missing; the crop offset is kept.
    quality
        Of the JPEG, 1..100; below 90 recognition suffers.

    Raises
    ------
    ValueError
        When a depth is negative or beyond 65.5 m, naming it.
    """
    depth = np.where(np.isfinite(frame.depth_m), frame.depth_m, 0.0)
    low, high = (float(depth.min()), float(depth.max())) if depth.size else (0.0, 0.0)
    if low < 0 or high > _MAX_STEPS * _COARSE_M:
        raise ValueError(f"depth must lie in 0..65.5 m, got {low} .. {high} m")
    unit = _COARSE_M if high > _MAX_STEPS * _FINE_M or _is_in_whole(depth, _COARSE_M) else _FINE_M
    sections = {SECTION_DEPTH: png(np.round(depth / unit).astype(np.uint16))}
    flags = 0
    if frame.rgb is not None:
        flags |= FLAG_COLOUR
        sections[SECTION_COLOUR] = jpeg(frame.rgb, quality)
    if frame.mask is not None:
        flags |= FLAG_MASK
        sections[SECTION_MASK] = png(frame.mask.astype(np.uint8) * 255)
    return pack(KIND_FRAME, flags, _header(frame, unit), sections)


def _is_in_whole(depth: NDArray[Any], unit: float) -> bool:
    """Tell whether every depth is a multiple of the unit, as exactly as float32 can say."""
    steps = np.round(depth / unit)
    return bool((np.abs(depth - steps * unit) <= np.spacing(np.float32(depth))).all())


def _header(frame: Frame, unit: float) -> dict[str, Any]:
    height, width = frame.depth_m.shape
    camera = frame.intrinsics
    header = {
        "width": width,
        "height": height,
        "x0": frame.x0,
        "y0": frame.y0,
        "full_width": camera.width,
        "full_height": camera.height,
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "depth_unit_m": unit,
        "frame_id": frame.frame_id,
        "stamp": frame.stamp_s,
    }
    return header | ({"mask_guessed": 1} if frame.is_mask_guessed else {})


def read_frame(container: Container, limits: Limits) -> Frame:
    """Return the frame of a container.

    Raises
    ------
    CloudFormatError
        When header and sections do not make a frame.
    """
    width, height = container.integer("width"), container.integer("height")
    limits.check_image(width, height)
    limits.check_points(width * height)
    unit = container.number("depth_unit_m")
    if not 0 < unit <= 0.01:
        raise CloudFormatError(f"header: depth_unit_m must lie in 0..0.01, got {unit}")
    try:
        camera = Intrinsics(
            container.integer("full_width"),
            container.integer("full_height"),
            *(container.number(key) for key in ("fx", "fy", "cx", "cy")),
        )
    except ValueError as error:
        raise CloudFormatError(f"header: {error}") from None
    shape = (height, width)
    steps = _decode(container.section(SECTION_DEPTH, "depth"), shape, "depth", limits)
    if steps.dtype != np.uint16 or steps.ndim != 2:
        raise CloudFormatError(f"depth: expected 16-bit grey, got {steps.dtype} {steps.shape}")
    rgb = mask = None
    if SECTION_COLOUR in container.sections:
        rgb = decode_image(container.sections[SECTION_COLOUR], shape, "colour", limits)
        if rgb.dtype != np.uint8 or rgb.shape != (*shape, 3):
            raise CloudFormatError(f"colour: expected 8-bit RGB, got {rgb.dtype} {rgb.shape}")
    if SECTION_MASK in container.sections:
        grey = _decode(container.sections[SECTION_MASK], shape, "mask", limits)
        if grey.ndim != 2:
            raise CloudFormatError(f"mask: expected one channel, got shape {grey.shape}")
        mask = grey > 0
    return Frame(
        depth_m=(steps * np.float32(unit)).astype(np.float32),
        intrinsics=camera,
        rgb=rgb,
        mask=mask,
        x0=container.integer("x0", 0),
        y0=container.integer("y0", 0),
        frame_id=container.text("frame_id"),
        stamp_s=container.number("stamp", 0.0),
        is_mask_guessed=container.integer("mask_guessed", 0) > 0,
    )


def _decode(section: Section, shape: tuple[int, int], name: str, limits: Limits) -> NDArray[Any]:
    if section.codec != CODEC_PNG:
        raise CloudFormatError(f"{name}: must be PNG, got codec {section.codec}")
    return decode_image(section, shape, name, limits)
