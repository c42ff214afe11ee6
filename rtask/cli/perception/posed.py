"""Where the camera of a recording was, by the transforms that were recorded with its views."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.perception.scene_file import is_recording
from rtask.cli.perception.view_options import View
from rtask.errors import DataError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.codec.types import Cloud
    from features.geometry import Frame
    from features.imaging.photo import Photo
    from rtask.ros2.transforms import TransformBuffer

__all__ = ["Posed", "posed_view"]

_SAME_NS = 1000
_BASES = ("base_footprint", "base_link")
"""Frames of a robot with z up (REP 105, REP 120), where ``--frame`` names none."""


@dataclass(frozen=True)
class Posed:
    """A view whose camera has a known place.

    Parameters
    ----------
    view
        With colours.
    base
        Name of a frame of the robot with z up.
    base_from_camera : (4, 4), m
    body : (h, w) bool or None
        Pixels of the robot itself, by its model in the recording; None without one.
    """

    view: Frame
    base: str
    base_from_camera: NDArray[np.float64]
    body: NDArray[np.bool_] | None = None


def posed_view(
    file: Path, view: View, seen: Frame | Cloud | Photo, *, is_cut_as_usual: bool
) -> Posed | None:
    """Return a view of a recording with the place of its camera, at the very time of the view.

    None where the view is cut in another way than a robot would, the file is no recording or holds
    no transforms, or the view is no coloured image with depth. Where its transforms do not lead to
    a usual base, a line says so, and None is returned.

    Raises
    ------
    UsageError
        ``--frame`` is of no use here, or names a frame to which the transforms do not lead then.
    DataError
        The recording is damaged.
    """
    import numpy as np

    from grasp.spatial.frames import matrix_from_pose

    if not is_cut_as_usual:
        if view.frame:
            raise UsageError("--frame: the view is cut by --segmentation, --mask or --box instead")
        return None
    frame = _coloured(seen)
    if not is_recording(file) or frame is None:
        if view.frame:
            raise UsageError(f"--frame: {file} shows no coloured view whose place TF could say")
        return None
    transforms, stamp_ns = _transforms_at(file, frame.stamp_s)
    reasons = []
    for base in (view.frame,) if view.frame else _BASES:
        pose = transforms.find(base, frame.frame_id, stamp_ns)
        if not isinstance(pose, str):
            doubt = transforms.doubt(base, frame.frame_id, stamp_ns)
            if doubt:
                click.echo(f"{file}: {doubt}", err=True)
            matrix = np.asarray(matrix_from_pose(np.array(pose.move), np.array(pose.turn)))
            body = _body(file, frame, base, matrix, transforms, stamp_ns)
            return Posed(frame, base, matrix, body)
        reasons.append(f"{base}: {pose}")
    if view.frame:
        raise UsageError(f"{file}: no way from {frame.frame_id!r} to --frame {reasons[0]}")
    if transforms:
        click.echo(
            f"{file}: places are in the camera's frame {frame.frame_id!r}, because its transforms "
            f"lead to no usual base ({'; '.join(reasons)}); --frame names another with z up",
            err=True,
        )
    return None


def _coloured(seen: Frame | Cloud | Photo) -> Frame | None:
    """Return a view as an image with depth and colours, or None if it is not one."""
    from features.codec.types import Cloud
    from features.geometry import Frame
    from features.imaging.camera import frame_of_grid

    view = frame_of_grid(seen) if isinstance(seen, Cloud) else seen
    return view if isinstance(view, Frame) and view.rgb is not None else None


def _body(
    file: Path,
    frame: Frame,
    base: str,
    base_from_camera: NDArray[np.float64],
    transforms: TransformBuffer,
    stamp_ns: int,
) -> NDArray[np.bool_] | None:
    """Return the pixels of the robot itself; what of it cannot be used is said in a line."""
    import numpy as np

    from features.imaging.recordings import robot_description
    from rtask.interop.ros.robot.body import body_of_json, body_pixels
    from rtask.interop.ros.robot.model import RobotModel

    urdf = robot_description(file)
    if not urdf:
        return None

    def lookup(link: str) -> NDArray[np.float64]:
        pose = transforms.find(base, link, stamp_ns)
        if isinstance(pose, str):
            raise UsageError(pose)
        return np.array(pose.as_matrix())

    try:
        model = RobotModel(urdf)
    except UsageError as error:
        click.echo(f"{file}: {error}; parts of the robot may be taken for objects", err=True)
        return None
    shapes, unplaced = model.placed(lookup, base)
    notes = model.notes
    if unplaced:
        notes = [*notes, f"its transforms do not say where {', '.join(unplaced)} are"]
    for note in notes:
        click.echo(f"{file}: {note}; parts of the robot may be taken for objects", err=True)
    if not shapes:
        return None
    return body_pixels(frame.points(), base_from_camera, body_of_json(shapes))


def _transforms_at(file: Path, stamp_s: float) -> tuple[TransformBuffer, int]:
    """Return the transforms about a time, and that time, ns.

    A time in s is exact to some .2 us in our days, and the newest transform is often as old as the
    view: to the nanosecond, the view would be one too late for it.
    """
    from features.codec import CloudFormatError
    from features.imaging.recordings import transforms_near
    from rtask.ros2.transforms import TransformBuffer

    made, stamp_ns = TransformBuffer(), round(stamp_s * 1e9)
    nearest = stamp_ns + _SAME_NS + 1
    try:
        for message, is_static in transforms_near(file, stamp_s):
            made.take(message, is_static=is_static)
            for stamped in message.transforms:
                at = stamped.header.stamp
                nearest = min(
                    nearest, at.sec * 10**9 + at.nanosec, key=lambda time: abs(time - stamp_ns)
                )
    except CloudFormatError as error:
        raise DataError(f"{file}: {error}") from error
    return made, nearest if abs(nearest - stamp_ns) <= _SAME_NS else stamp_ns
