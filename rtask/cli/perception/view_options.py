"""Options of perception commands about how a picture is read: its camera, unit and time."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.errors import TooLargeError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.geometry import Intrinsics
    from features.imaging.camera import Lens

__all__ = ["OPTIONS", "Cameras", "View", "bytes_of", "camera_options", "read_cameras"]

_DEFAULT_FOCAL = 525.0 / 640
OPTIONS = {
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
        Metres of one step of depth; None = 1 mm (REP 118), and said.
    focal, focal_y, centre
        In pixels; None for those of a common depth camera at the image's size, and said.
    distortion
        Coefficients of the lens.
    camera
        JSON that says all this, instead of the numbers.
    at_s
        Of a recording: which frame, s after its start.
    frame
        Of a recording: frame of the robot with z up for places; empty = a usual base.
    is_stored
        Whether sizes are stored beyond the answer: a guess of the camera is refused then.
    """

    colour: Path | None = None
    depth_unit_m: float | None = None
    focal: float | None = None
    focal_y: float | None = None
    centre: tuple[float, float] | None = None
    distortion: tuple[float, ...] = ()
    camera: Path | None = None
    at_s: float = 0.0
    frame: str = ""
    is_stored: bool = False

    @property
    def given(self) -> tuple[str, ...]:
        """The options that differ from their defaults, as they are written."""
        usual = View()
        return tuple(
            name
            for name, field_name in OPTIONS.items()
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
    notes
        What is doubtful of them, or was assumed.
    """

    depth: Lens
    colour: Lens | None = None
    colour_from_depth: NDArray[np.float64] | None = field(default=None, compare=False)
    notes: tuple[str, ...] = ()


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
        depth_unit: float | None,
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
        click.option(
            "--focal", type=float, help="Focal length, px.  [default: 525 at 640 px, and said]"
        ),
        click.option(
            "--depth-unit", type=float,
            help="Size of one depth step, m.  [default: 0.001, and said]",
        ),
        click.option(
            "--colour", type=file,
            help="Colour image that belongs to the depth image FILE; of any resolution.",
        ),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return wrapped


def read_cameras(shape: tuple[int, ...], view: View) -> Cameras:
    """Return the cameras of the options, or of the file that describes them.

    Raises
    ------
    UsageError
        They describe no camera, or one of another size than the image (h, w, ...); or nothing
        describes it, and sizes are to be kept.
    """
    import numpy as np

    from features.imaging.camera import Lens, lens_from_message, lens_of_size

    if view.camera is None:
        camera = _camera(shape, view)
        notes = (_guess(camera, view),) if view.focal is None else _doubts(camera)
        try:
            return Cameras(Lens(camera, view.distortion), notes=notes)
        except ValueError as error:
            raise UsageError(f"--distortion: {error}") from error
    try:
        try:
            fields = json.loads(bytes_of(view.camera, 2**20))
        except ValueError as error:
            raise ValueError(f"no JSON: {error}") from error
        if not isinstance(fields, dict):
            raise ValueError("a JSON object is expected")
        camera_info = fields.get("depth", fields)
        depth = lens_from_message(camera_info)
        notes = (*_doubts(depth.intrinsics), *_straightened(depth, camera_info))
        if any(camera_info.get(name) for name in ("roi", "binning_x", "binning_y")):
            depth = lens_of_size(depth, camera_info, (shape[0], shape[1]))
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
    return Cameras(depth, colour, pose, notes)


def _guess(camera: Intrinsics, view: View) -> str:
    """Return what is assumed of a camera that nothing describes.

    No depth image tells its focal length, and places across grow with what is assumed.

    Raises
    ------
    UsageError
        Sizes are to be kept: a guess would be stored as a measurement.
    """
    import numpy as np

    if view.is_stored:
        raise UsageError(
            "nothing says which camera took the depth image, and its sizes would be stored: "
            "--camera or --focal says it"
        )
    across_deg = np.degrees(2 * np.arctan(camera.width / (2 * camera.fx)))
    return (
        f"nothing says which camera took it: taken for one that sees {across_deg:.0f} degrees "
        f"across (a focal length of {camera.fx:.4g} px), and places to the side are right only if "
        "that is; --camera or --focal says it"
    )


def _doubts(camera: Intrinsics) -> tuple[str, ...]:
    from features.imaging.doubts import doubtful_camera

    doubt = doubtful_camera(camera)
    return (doubt,) if doubt else ()


def _straightened(lens: Lens, camera_info: dict[str, Any]) -> tuple[str, ...]:
    """Return that an image is taken for raw, where its CameraInfo describes a rectified one too."""
    from features.imaging.camera import lens_from_message

    if not lens.is_distorted or lens_from_message(camera_info, is_rectified=True).intrinsics == (
        lens.intrinsics
    ):
        return ()
    return (
        "its CameraInfo has a distortion and a P for rectified images: the image is taken for raw "
        "and straightened; leave D out, and P in place of K, for one that was rectified",
    )


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


def bytes_of(file: Path, most: int) -> bytes:
    """Return the bytes of a file of at most that size."""
    try:
        size = file.stat().st_size
        if size > most:
            raise TooLargeError(f"{file}: {size} bytes; at most {most} are read")
        return file.read_bytes()
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from error
