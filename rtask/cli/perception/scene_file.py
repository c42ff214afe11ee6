"""Input files of perception commands: clouds, crops, image pairs, photographs, recordings."""

from __future__ import annotations

import json
import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.errors import DataError, TooLargeError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.codec.limits import Limits
    from features.codec.types import Cloud
    from features.geometry import Frame, Intrinsics
    from features.imaging.camera import Lens
    from features.imaging.photo import Photo

__all__ = [
    "View",
    "camera_options",
    "is_recording",
    "read_cameras",
    "read_image",
    "read_scene",
    "read_view",
    "save_picture",
]

log = logging.getLogger(__name__)

_DEPTH_BITS = 16
_RECORDINGS = (".bag", ".mcap", ".db3")
_DEFAULT_FOCAL = 525.0 / 640
_STORED_BYTES = 256 * 2**20
_OPTIONS = {
    "--colour": "colour",
    "--depth-unit": "depth_unit_m",
    "--focal": "focal",
    "--focal-y": "focal_y",
    "--centre": "centre",
    "--distortion": "distortion",
    "--camera": "camera",
    "--at": "at_s",
    "--frame": "frame",
}


@dataclass(frozen=True)
class View:
    """The settings for reading a picture.

    Parameters
    ----------
    colour
        Colour image that belongs to the depth image.
    depth_unit_m
        Metres of one step of depth.
    focal, focal_y, centre
        In pixels; None for those of a common depth camera at the image's size.
    distortion
        Coefficients of the lens.
    camera
        JSON that says all this, instead of the numbers.
    at_s
        Of a recording: which frame, s after its start.
    frame
        Of a recording: frame of the robot with z up for places; empty = a usual base.
    """

    colour: Path | None = None
    depth_unit_m: float = 0.001
    focal: float | None = None
    focal_y: float | None = None
    centre: tuple[float, float] | None = None
    distortion: tuple[float, ...] = ()
    camera: Path | None = None
    at_s: float = 0.0
    frame: str = ""

    @property
    def given(self) -> tuple[str, ...]:
        """The options that differ from their defaults, as they are written."""
        usual = View()
        return tuple(
            name
            for name, field_name in _OPTIONS.items()
            if repr(getattr(self, field_name)) != repr(getattr(usual, field_name))
        )


@dataclass(frozen=True)
class Cameras:
    """Cameras of a pair of images, and where they stand.

    Parameters
    ----------
    colour
        None = the camera of depth.
    colour_from_depth : (4, 4) or None
    """

    depth: Lens
    colour: Lens | None = None
    colour_from_depth: NDArray[np.float64] | None = field(default=None, compare=False)


def _coefficients(
    context: click.Context, option: click.Parameter, text: str | None
) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in (text or "").replace(",", " ").split())
    except ValueError:
        raise click.BadParameter(f"{text!r}: numbers with commas between are expected") from None


def camera_options(command: Any) -> Any:
    """Add the options of :class:`View` to a command, which gets them as ``view``."""
    import functools

    @functools.wraps(command)
    def with_view(
        *args: Any,
        colour: Path | None,
        depth_unit: float,
        focal: float | None,
        focal_y: float | None,
        centre: tuple[float, float] | None,
        distortion: tuple[float, ...],
        camera: Path | None,
        at_s: float,
        base_frame: str,
        **rest: Any,
    ) -> Any:
        view = View(
            colour, depth_unit, focal, focal_y, centre, distortion, camera, at_s, base_frame
        )
        return command(*args, view=view, **rest)

    wrapped: Any = with_view
    file = click.Path(exists=True, dir_okay=False, path_type=Path)
    for option in (
        click.option(
            "--at", "at_s", type=click.FloatRange(min=0), default=0.0, metavar="S",
            help="Of a recording: the frame at this time after its start, s.",
        ),
        click.option(
            "--frame", "base_frame", default="", metavar="NAME",
            help="Of a recording: frame of the robot with z up, in which its TF says where the "
            "camera was.  [default: base_footprint or base_link]",
        ),
        click.option(
            "--camera", type=file,
            help="JSON of the camera in place of the numbers: a sensor_msgs/CameraInfo, or {depth, "
            "colour, colour_from_depth} where colour has its own.",
        ),
        click.option(
            "--distortion", callback=_coefficients, metavar="K1,K2,P1,P2,...",
            help="Distortion of the lens, as OpenCV and ROS order it.",
        ),
        click.option(
            "--centre", nargs=2, type=float, help="Principal point, px.  [default: the middle]"
        ),
        click.option("--focal-y", type=float, help="Focal length down, px.  [default: as across]"),
        click.option("--focal", type=float, help="Focal length, px.  [default: 525 at 640 px]"),
        click.option(
            "--depth-unit", type=float, default=0.001, show_default=True,
            help="Size of one depth step, m.",
        ),
        click.option(
            "--colour", type=file,
            help="Colour image that belongs to the depth image FILE; of any resolution.",
        ),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return wrapped


def read_scene(file: Path, view: View) -> Frame | Cloud:
    """Read a cloud, a crop, a depth image or a recording.

    Raises
    ------
    UsageError
        The options do not fit the file: an image without depth, an impossible camera.
    DataError
        The file is damaged, or of another kind.
    TooLargeError
        It declares a size beyond the limits.
    """
    from features.imaging.photo import Photo

    seen = read_view(file, view)
    if isinstance(seen, Photo):
        raise UsageError(
            f"{file} is an image of 8 bits, without depth; FILE must be a 16-bit depth image, and "
            "--colour its colour image"
        )
    return seen


def is_recording(file: Path) -> bool:
    """Return whether a file is to be read as a recording of ROS."""
    return file.suffix in _RECORDINGS or file.is_dir()


def read_view(file: Path, view: View) -> Frame | Cloud | Photo:
    """Read what :func:`read_scene` reads, or a photograph.

    Raises
    ------
    UsageError, DataError, TooLargeError
        As :func:`read_scene`.
    """
    from features.codec import CloudFormatError, decode
    from features.codec.image_header import is_image
    from features.codec.limits import Limits, UnknownFormatError
    from features.codec.types import Cloud
    from features.imaging.doubts import implausible_cloud
    from features.imaging.placed import in_camera_frame

    if is_recording(file):
        if file.is_dir() and not (file / "metadata.yaml").is_file():
            raise UsageError(f"{file} is a folder, and no recording of ROS 2: no metadata.yaml")
        _allow(file, "a recording, which tells its camera", view, ("--at", "--frame"))
        return _recorded(file, view)
    # A local file may be larger than what a robot may send, but not what it unpacks to.
    limits = Limits(stored_bytes=_STORED_BYTES)
    data = _bytes_of(file, limits.stored_bytes)
    try:
        if is_image(data):
            return _picture(file, data, view, limits)
        seen = decode(data, limits)
    except UnknownFormatError:
        begins = f"it starts with {data[:8].hex(' ')}" if data else "it is empty"
        raise DataError(
            f"{file}: no picture (JPEG, PNG, WebP, BMP, TIFF), cloud (PCD, PLY), crop that robots "
            f"send or recording ({', '.join(_RECORDINGS)}): {begins}"
        ) from None
    except CloudFormatError as error:
        raise DataError(f"{file}: {error}") from error
    _allow(file, "a cloud", view, ())
    if isinstance(seen, Cloud):
        _say_doubt(file, implausible_cloud(seen.positions))
        seen, note = in_camera_frame(seen)
        _say_doubt(file, note)
    return seen


def _say_doubt(file: Path, doubt: str) -> None:
    """Say on the error output what of a file is doubtful, or was taken for something, if any."""
    if doubt:
        click.echo(f"{file}: {doubt}", err=True)


def _allow(file: Path, kind: str, view: View, options: tuple[str, ...]) -> None:
    """Refuse options that would have no effect on a file of this kind."""
    without = [name for name in view.given if name not in options]
    if without:
        raise UsageError(f"{' and '.join(without)}: no use here, {file} is {kind}")


def _recorded(file: Path, view: View) -> Frame | Cloud | Photo:
    from features.codec import CloudFormatError
    from features.imaging.recordings import first_view
    from rtask.extras import naming_extras

    try:
        with naming_extras(str(file)):
            return first_view(file, view.at_s, lambda text: click.echo(text, err=True))
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


def _picture(file: Path, data: bytes, view: View, limits: Limits) -> Frame | Photo:
    """Read a depth image, with its colour image if there is one; or a photograph."""
    import numpy as np

    from features.codec.image_header import bits_of, is_cut_off
    from features.depth import depth_of_steps
    from features.imaging.doubts import (
        doubtful_distortion,
        doubtful_inverse,
        doubtful_rays,
        doubtful_steps,
        implausible_depth,
    )
    from features.imaging.photo import read_photo

    if is_cut_off(data):
        raise DataError(f"{file}: the PNG is cut off")
    if bits_of(data) != _DEPTH_BITS:
        if view.colour is not None:
            kind = "an image of 8 bits"
            raise UsageError(f"{file} is {kind}; FILE must be a 16-bit depth image beside --colour")
        _allow(file, "a photograph, read without a camera", view, ())
        return read_photo(data)
    _allow(file, "a depth image", view, tuple(name for name in _OPTIONS if name != "--at"))
    depth = read_image(file, data, limits)
    if depth.ndim == 3 or depth.dtype != np.uint16:
        raise UsageError(f"{file} is a colour image of 16 bits; save it with 8 bits a channel")
    if not 1e-6 <= view.depth_unit_m <= 1.0:
        raise UsageError(f"--depth-unit {view.depth_unit_m} m: expected 0.000001 to 1")
    depth_m = depth_of_steps(depth, view.depth_unit_m, lambda text: _say_doubt(file, text))
    # Who names the unit knows it.
    is_usual = view.depth_unit_m == View().depth_unit_m
    doubt = doubtful_steps(depth) if is_usual else ""
    _say_doubt(file, implausible_depth(depth_m) or (doubt and f"{doubt} --depth-unit says it"))
    seen = _with_colour(depth_m, view, read_cameras(depth.shape, view), limits)
    doubt = doubtful_distortion(depth_m, seen.depth_m) or doubtful_inverse(depth_m)
    doubt = doubt or doubtful_rays(seen.depth_m, seen.intrinsics)
    _say_doubt(file, doubt)
    return seen


def _with_colour(
    depth_m: NDArray[np.float32], view: View, cameras: Cameras, limits: Limits
) -> Frame:
    import numpy as np

    from features.geometry import Frame
    from features.imaging.camera import align_colour, undistorted

    _, straight = undistorted(cameras.depth, None, depth_m)
    assert straight is not None
    camera = cameras.depth.intrinsics
    if view.colour is None:
        return Frame(straight, camera)
    rgb = read_image(view.colour, _bytes_of(view.colour, limits.stored_bytes), limits)
    if rgb.ndim == 2:
        rgb = np.repeat(rgb[..., None], 3, axis=2)
    if rgb.dtype != np.uint8:
        raise UsageError(f"{view.colour}: expected 8-bit colours, got {rgb.dtype}")
    rgb = np.ascontiguousarray(rgb[..., 2::-1])
    try:
        if cameras.colour is None:
            # One lens took both, at whatever resolution.
            aligned = align_colour(depth_m, camera, rgb)
            pixels, _ = undistorted(cameras.depth, aligned.rgb)
            return Frame(straight, camera, pixels)
        lens = cameras.colour
        if rgb.shape[:2] != (lens.intrinsics.height, lens.intrinsics.width):
            raise ValueError(
                f"the shape {rgb.shape[:2]} is not that of its camera, "
                f"{lens.intrinsics.width}x{lens.intrinsics.height} px"
            )
        pixels, _ = undistorted(lens, rgb)
        assert pixels is not None
        pose = cameras.colour_from_depth
        return align_colour(straight, camera, pixels, lens.intrinsics, pose)
    except ValueError as error:
        raise UsageError(f"{view.colour}: {error}") from error


def read_image(file: Path, data: bytes, limits: Limits) -> NDArray[Any]:
    """Decode an image, as BGR or grey of any depth, after checking the size in its header.

    Raises
    ------
    DataError
        It is damaged, or larger than the limits.
    """
    import cv2
    import numpy as np

    from features.codec import CloudFormatError
    from features.codec.image_header import image_size, is_cut_off

    try:
        limits.check_image(*image_size(data))
    except CloudFormatError as error:
        raise DataError(f"{file}: {error}") from error
    if is_cut_off(data):
        raise DataError(f"{file}: the PNG is cut off")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DataError(f"{file}: the image does not decode ({error.err})") from None
    if image is None:
        raise DataError(f"{file}: the image does not decode")
    return np.asarray(image)


def read_cameras(shape: tuple[int, ...], view: View) -> Cameras:
    """Return the cameras of the options, or of the file that describes them.

    Raises
    ------
    UsageError
        They describe no camera, or one of another size than the image (h, w, ...).
    """
    import numpy as np

    from features.imaging.camera import Lens, lens_from_message

    if view.camera is None:
        try:
            return Cameras(Lens(_camera(shape, view), view.distortion))
        except ValueError as error:
            raise UsageError(f"--distortion: {error}") from error
    try:
        try:
            fields = json.loads(_bytes_of(view.camera, 2**20))
        except ValueError as error:
            raise ValueError(f"no JSON: {error}") from error
        if not isinstance(fields, dict):
            raise ValueError("a JSON object is expected")
        depth = lens_from_message(fields.get("depth", fields))
        colour = lens_from_message(fields["colour"]) if "colour" in fields else None
        pose = np.array(fields.get("colour_from_depth", np.eye(4)), np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise ValueError(f"colour_from_depth must be a transform (4, 4), got {pose.shape}")
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise UsageError(f"{view.camera}: {error}") from error
    if (depth.intrinsics.height, depth.intrinsics.width) != shape[:2]:
        raise UsageError(
            f"{view.camera}: the camera has {depth.intrinsics.width}x{depth.intrinsics.height} px, "
            f"the image {shape[1]}x{shape[0]}"
        )
    return Cameras(depth, colour, pose)


def _camera(shape: tuple[int, ...], view: View) -> Intrinsics:
    from features.geometry import Intrinsics

    height, width = shape[:2]
    focal = _DEFAULT_FOCAL * width if view.focal is None else view.focal
    focal_y = focal if view.focal_y is None else view.focal_y
    centre = ((width - 1) / 2, (height - 1) / 2) if view.centre is None else view.centre
    try:
        camera = Intrinsics(width, height, focal, focal_y, *centre)
    except ValueError as error:
        raise UsageError(str(error)) from error
    inside = 0 <= camera.cx < width and 0 <= camera.cy < height
    usual = all(0.1 < value / max(width, height) < 20 for value in (focal, focal_y))
    if not inside or not usual:
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
