"""Images of clouds, crops and attempts: decode, check, encode, render."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError

if TYPE_CHECKING:
    from features.geometry import Frame, Intrinsics

__all__ = [
    "check_picture",
    "decode_picture",
    "encode_crop",
    "encode_photo",
    "frame_of_cloud",
    "media_type_of",
    "shaded",
    "with_image",
]

_RENDERED_PX = 240
_JPEG_QUALITY = 92
MAX_PX = 16_000_000


def media_type_of(data: bytes) -> str | None:
    """Return ``image/png`` or ``image/jpeg``, judged by the first bytes, or None."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    return "image/jpeg" if data.startswith(b"\xff\xd8\xff") else None


def check_picture(data: bytes, path: str) -> tuple[str, int, int]:
    """Return media type, width and height of a PNG or JPEG.

    Raises
    ------
    UsageError
        If the data are neither, or cannot be decoded.
    """
    media_type = media_type_of(data)
    if media_type is None:
        raise UsageError(f"{path}: expected PNG or JPEG, starts with {data[:8].hex(' ')}")
    height, width = decode_picture(data, path).shape[:2]
    return media_type, width, height


def decode_picture(data: bytes, path: str) -> NDArray[np.uint8]:
    """Return the picture (h, w, 3) uint8 RGB of an encoded image, of at most 16 megapixels.

    Raises
    ------
    UsageError
        If the bytes at ``path`` of the request are no such image.
    """
    import cv2

    from features.codec.image_header import image_size

    try:
        width, height = image_size(data)
    except ValueError as error:
        raise UsageError(f"{path}: {error}", field=path) from error
    if width * height > MAX_PX:
        raise UsageError(f"{path}: the image is larger than {MAX_PX // 10**6} Mpx", field=path)
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None or image.shape[0] * image.shape[1] > MAX_PX:
        raise UsageError(f"{path}: the image cannot be decoded or is larger than 16 Mpx")
    return np.asarray(image[:, :, ::-1], dtype=np.uint8)


def encode_crop(frame: Frame) -> bytes:
    """Return the object's image crop as JPEG, of a quality that preserves features."""
    import cv2

    if frame.rgb is None:
        raise UsageError("the frame has no colour image")
    quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(frame.rgb[:, :, ::-1]), quality)
    if not done:
        raise UsageError(f"cannot encode an image of shape {frame.rgb.shape}")
    return bytes(data)


def encode_photo(frame: Frame) -> bytes:
    """Return the crop of a photograph in the project's format, of the same quality."""
    from features.codec import encode_frame

    return encode_frame(frame, _JPEG_QUALITY)


def with_image(frame: Frame, data: bytes) -> Frame:
    """Return the frame with its image of the object replaced.

    A picture of the whole camera's view, at its resolution or a higher one, is cut out where the
    frame is. Any other image whose size differs from the frame's has no depth, since the position
    of its pixels is unknown.
    """
    from dataclasses import replace

    from features.geometry import Frame, Intrinsics

    rgb = np.ascontiguousarray(decode_picture(data, "image"))
    if rgb.shape[:2] == frame.depth_m.shape:
        return replace(frame, rgb=rgb)
    height, width = rgb.shape[:2]
    if _shows_view(frame.intrinsics, width, height):
        return _of_view(frame, rgb)
    camera = Intrinsics.from_fov(width, height, 1.0)
    nothing = np.zeros((height, width), np.float32)
    everywhere = np.ones((height, width), dtype=bool)
    return Frame(nothing, camera, rgb, everywhere, frame_id=frame.frame_id)


def _shows_view(camera: Intrinsics, width: int, height: int) -> bool:
    """Tell whether an image has the sides of the camera's view, at least at its resolution."""
    across, down = width / camera.width, height / camera.height
    return across >= 1 and abs(across / down - 1) < 0.005


def _of_view(frame: Frame, rgb: NDArray[np.uint8]) -> Frame:
    """Return a frame with its part of the whole view, in which depth is picked from the nearest."""
    import cv2

    from features.geometry import Frame
    from features.imaging.camera import scaled

    camera = scaled(frame.intrinsics, rgb.shape[1], rgb.shape[0])
    times = camera.fx / frame.intrinsics.fx
    rows, columns = frame.depth_m.shape
    x0, y0 = round(frame.x0 * times), round(frame.y0 * times)
    x1, y1 = round((frame.x0 + columns) * times), round((frame.y0 + rows) * times)
    size = (x1 - x0, y1 - y0)
    depth = cv2.resize(frame.depth_m, size, interpolation=cv2.INTER_NEAREST)
    mine = frame.object_mask().astype(np.uint8)
    mask = np.asarray(cv2.resize(mine, size, interpolation=cv2.INTER_NEAREST))
    return Frame(
        np.asarray(depth, np.float32), camera, rgb[y0:y1, x0:x1].copy(), mask > 0, x0, y0,
        frame.frame_id, frame.stamp_s,
    )  # fmt: skip


def frame_of_cloud(
    points: NDArray[np.floating[Any]], colours: NDArray[np.uint8] | None
) -> tuple[Frame, NDArray[np.float64]]:
    """Render a cloud as seen from the origin of its frame (Gatto 2016, 3.2.4).

    Parameters
    ----------
    points : (n, 3), m
    colours : (n, 3) uint8 or None

    Returns
    -------
    frame
        With colour, depth and mask.
    cloud_from_camera : (4, 4)
        Pose of the virtual camera in the frame of the cloud.

    Raises
    ------
    UsageError
        If there are too few points.
    """
    import cv2

    from features.geometry import Frame, Intrinsics

    keep = np.isfinite(points).all(axis=1)
    cloud = np.asarray(points[keep], dtype=np.float64)
    if len(cloud) < 10:
        raise UsageError(f"data: {len(cloud)} points are too few for an object")
    cloud_from_camera = _look_at(cloud.mean(axis=0))
    local = (cloud - cloud_from_camera[:3, 3]) @ cloud_from_camera[:3, :3]
    local = local[:, :3]
    ahead = local[:, 2] > 0.01
    local = local[ahead]
    spread = np.abs(local[:, :2] / local[:, 2:]).max()
    focal = _RENDERED_PX * 0.45 / float(spread)
    centre = (_RENDERED_PX - 1) / 2
    camera = Intrinsics(_RENDERED_PX, _RENDERED_PX, focal, focal, centre, centre)
    u = np.rint(local[:, 0] / local[:, 2] * focal + centre).astype(int)
    v = np.rint(local[:, 1] / local[:, 2] * focal + centre).astype(int)
    order = np.argsort(-local[:, 2], kind="stable")  # the nearest point is written last
    depth = np.zeros((_RENDERED_PX, _RENDERED_PX), np.float32)
    rgb = np.full((_RENDERED_PX, _RENDERED_PX, 3), 255, np.uint8)
    depth[v[order], u[order]] = local[order, 2]
    if colours is not None:
        rgb[v[order], u[order]] = np.asarray(colours)[keep][ahead][order]
    mask = depth > 0
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    holes = (closed > 0) & ~mask
    rgb = np.asarray(cv2.inpaint(rgb, holes.astype(np.uint8), 3, cv2.INPAINT_TELEA), dtype=np.uint8)
    if colours is None:
        rgb = shaded(depth, closed > 0)
    return Frame(depth, camera, rgb, closed > 0), cloud_from_camera


def shaded(depth_m: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Render depth as an image (h, w, 3): near is light, far is dark, the background white."""
    is_measured = mask & np.isfinite(depth_m) & (depth_m > 0)
    grey = np.full(depth_m.shape, 255, np.uint8)
    if is_measured.any():
        near, far = float(depth_m[is_measured].min()), float(depth_m[is_measured].max())
        share = (far - depth_m[is_measured]) / max(far - near, 1e-6)
        grey[is_measured] = np.rint(40 + 180 * share).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def _look_at(target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pose of an optical frame at the origin that looks at ``target``."""
    forward = target / max(float(np.linalg.norm(target)), 1e-9)
    # In a camera's own optical frame y points down; in any other frame here z points up.
    down = np.array([0.0, 1.0, 0.0]) if forward[2] > 0.7 else np.array([0.0, 0.0, -1.0])
    right = np.cross(down, forward)
    right /= max(float(np.linalg.norm(right)), 1e-9)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(forward, right), forward
    return pose
