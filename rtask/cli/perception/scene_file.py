"""Input files of the perception commands: a cloud, a crop of a robot, or a pair of images."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.errors import DataError, TooLargeError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.codec.types import Cloud
    from features.geometry import Frame, Intrinsics

__all__ = ["View", "camera_options", "read_scene", "save_picture"]

log = logging.getLogger(__name__)

_PNG = b"\x89PNG\r\n\x1a\n"
_IMAGES = (_PNG, b"\xff\xd8\xff")
_DEFAULT_FOCAL = 525.0 / 640


@dataclass(frozen=True)
class View:
    """How to read a depth image.

    Parameters
    ----------
    colour
        Colour image that belongs to the depth image.
    depth_unit_m
        Metres of one step of depth.
    focal, centre
        In pixels; None for those of a common depth camera at the image's size.
    """

    colour: Path | None = None
    depth_unit_m: float = 0.001
    focal: float | None = None
    centre: tuple[float, float] | None = None


def camera_options(command: Any) -> Any:
    """Add the options of :class:`View` to a command."""
    for option in (
        click.option(
            "--centre", nargs=2, type=float, help="Principal point, px.  [default: the middle]"
        ),
        click.option("--focal", type=float, help="Focal length, px.  [default: 525 at 640 px]"),
        click.option(
            "--depth-unit",
            type=float,
            default=0.001,
            show_default=True,
            help="Size of one depth step, m.",
        ),
        click.option(
            "--colour",
            type=click.Path(exists=True, dir_okay=False, path_type=Path),
            help="Colour image that belongs to the depth image FILE.",
        ),
    ):
        command = option(command)
    return command


def read_scene(file: Path, view: View) -> Frame | Cloud:
    """Read a cloud, a crop or a depth image.

    Raises
    ------
    UsageError
        The options do not fit the file: an image without depth, an impossible camera.
    DataError
        The file is damaged, or of another kind.
    TooLargeError
        It declares a size beyond the limits.
    """
    from features.codec import CloudFormatError, decode
    from features.codec.limits import Limits

    # A local file may be larger than what a robot may send, but not what it unpacks to.
    limits = Limits(stored_bytes=256 * 2**20)
    data = _bytes_of(file, limits.stored_bytes)
    try:
        if data.startswith(_IMAGES):
            return _pair(file, data, view, limits)
        if view.colour is not None:
            raise UsageError(f"--colour goes with a depth image; {file} is a cloud")
        return decode(data, limits)
    except CloudFormatError as error:
        raise DataError(f"{file}: {error}") from error


def _bytes_of(file: Path, most: int) -> bytes:
    try:
        size = file.stat().st_size
        if size > most:
            raise TooLargeError(f"{file}: {size} bytes; at most {most} are read")
        return file.read_bytes()
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from error


def _pair(file: Path, data: bytes, view: View, limits: Any) -> Frame:
    """Read a depth image, with its colour image if there is one."""
    import numpy as np

    from features.geometry import Frame

    depth = _image(file, data, limits)
    if depth.ndim == 3 or depth.dtype != np.uint16:
        kind = "a colour image" if depth.ndim == 3 else f"an image of {8 * depth.itemsize} bits"
        raise UsageError(
            f"{file} is {kind}; FILE must be a 16-bit depth image, and --colour its colour image"
        )
    rgb = None
    if view.colour is not None:
        rgb = _image(view.colour, _bytes_of(view.colour, limits.stored_bytes), limits)
        if rgb.ndim == 2:
            rgb = np.repeat(rgb[..., None], 3, axis=2)
        if rgb.dtype != np.uint8 or rgb.shape[:2] != depth.shape:
            raise UsageError(
                f"{view.colour}: expected 8-bit colours of shape {depth.shape}, "
                f"got {rgb.dtype} of {rgb.shape[:2]}"
            )
        rgb = np.ascontiguousarray(rgb[..., 2::-1])
    if not 1e-6 <= view.depth_unit_m <= 1.0:
        raise UsageError(f"--depth-unit {view.depth_unit_m} m: expected 0.000001 to 1")
    camera = _camera(depth.shape, view)
    return Frame((depth * view.depth_unit_m).astype(np.float32), camera, rgb)


def _image(file: Path, data: bytes, limits: Any) -> NDArray[Any]:
    """Decode an image, as BGR or grey of any depth, after checking the size in its header."""
    import cv2
    import numpy as np

    from features.codec.image import image_size

    limits.check_image(*image_size(data))
    if data.startswith(_PNG) and b"IEND" not in data[-16:]:
        raise DataError(f"{file}: the PNG is cut off")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DataError(f"{file}: the image does not decode ({error.err})") from None
    if image is None:
        raise DataError(f"{file}: the image does not decode")
    return np.asarray(image)


def _camera(shape: tuple[int, ...], view: View) -> Intrinsics:
    from features.geometry import Intrinsics

    height, width = shape[:2]
    focal = _DEFAULT_FOCAL * width if view.focal is None else view.focal
    centre = ((width - 1) / 2, (height - 1) / 2) if view.centre is None else view.centre
    try:
        camera = Intrinsics(width, height, focal, focal, *centre)
    except ValueError as error:
        raise UsageError(str(error)) from error
    inside = 0 <= camera.cx < width and 0 <= camera.cy < height
    if not inside or not 0.1 < focal / max(width, height) < 20:
        raise UsageError(
            f"focal {focal:g} px and centre ({camera.cx:g}, {camera.cy:g}) px cannot belong to an "
            f"image of {width}x{height} px"
        )
    return camera


def save_picture(file: Path, image: NDArray[np.uint8]) -> None:
    """Write an RGB image in the format of the file's extension."""
    import cv2
    import numpy as np

    try:
        done, data = cv2.imencode(file.suffix or ".png", np.ascontiguousarray(image[..., ::-1]))
    except cv2.error:
        done = False
    if not done:
        raise UsageError(f"{file}: unknown picture format; use .png or .jpg")
    try:
        file.write_bytes(data.tobytes())
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from error
