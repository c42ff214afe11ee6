"""Input files of perception commands: clouds, crops, image pairs, photographs, recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.perception.view_options import OPTIONS, Cameras, View, bytes_of, read_cameras
from rtask.errors import DataError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.codec.limits import Limits
    from features.codec.types import Cloud
    from features.geometry import Frame
    from features.imaging.photo import Photo

__all__ = [
    "is_recording",
    "read_depth",
    "read_image",
    "read_scene",
    "read_view",
    "save_picture",
]

_DEPTH_BITS = 16
_RECORDINGS = (".bag", ".mcap", ".db3")
_STORED_BYTES = 256 * 2**20


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
    data = bytes_of(file, limits.stored_bytes)
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


def _say_doubt(file: Path, doubt: str, *, is_once: bool = False) -> None:
    """Say on the error output what of a file is doubtful, or was taken for something, if any.

    Parameters
    ----------
    is_once
        Whether it is said of the first file of a command only, as what no option says is the same
        of all.
    """
    context = click.get_current_context(silent=True)
    if is_once and context is not None:
        before = context.meta.setdefault(f"{__name__}.said", set())
        if doubt in before:
            return
        before.add(doubt)
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


def _picture(file: Path, data: bytes, view: View, limits: Limits) -> Frame | Photo:
    """Read a depth image, with its colour image if there is one; or a photograph."""
    from features.codec.image_header import bits_of, is_cut_off, is_grey_of_floats
    from features.imaging.doubts import doubtful_distortion, doubtful_inverse, doubtful_rays
    from features.imaging.photo import read_photo

    if is_cut_off(data):
        raise DataError(f"{file}: the PNG is cut off")
    if bits_of(data) != _DEPTH_BITS and not is_grey_of_floats(data):
        if view.colour is not None:
            kind = "an image of 8 bits"
            raise UsageError(f"{file} is {kind}; FILE must be a 16-bit depth image beside --colour")
        _allow(file, "a photograph, read without a camera", view, ())
        photo = read_photo(data)
        _say_doubt(file, photo.doubt)
        return photo
    _allow(file, "a depth image", view, tuple(name for name in OPTIONS if name != "--at"))
    image = read_image(file, data, limits)
    try:
        cameras = read_cameras(image.shape, view)
    except UsageError as error:
        # Several files may be read with one set of options: which one lacks a camera matters.
        raise UsageError(f"{file}: {error}") from error
    for note in cameras.notes:
        _say_doubt(file, note, is_once=True)
    depth_m = read_depth(file, image, view.depth_unit_m)
    seen = _with_colour(file, data, depth_m, view, cameras, limits)
    doubt = doubtful_distortion(depth_m, seen.depth_m) or doubtful_inverse(depth_m)
    doubt = doubt or doubtful_rays(seen.depth_m, seen.intrinsics)
    _say_doubt(file, doubt)
    return seen


def read_depth(file: Path, image: NDArray[Any], unit_m: float | None = None) -> NDArray[np.float32]:
    """Return the depth (h, w), m, of the numbers of an image; what is doubtful of them is said.

    Parameters
    ----------
    image
        As :func:`read_image` returns it: whole numbers of 16 bits, or numbers with decimals (TIFF).
    unit_m
        Of one of them, m; None = millimetres, or metres where they have decimals (REP 118).

    Raises
    ------
    UsageError
        It is no depth image, or the unit is none.
    """
    import numpy as np

    from features.depth import depth_of_metres, depth_of_steps
    from features.imaging.doubts import doubtful_steps, implausible_depth

    if image.ndim == 3:
        raise UsageError(f"{file} is a colour image of 16 bits; save it with 8 bits a channel")
    if image.dtype not in (np.uint16, np.int16, np.float32, np.float64):
        raise UsageError(f"{file} has numbers of the type {image.dtype}, and is no depth image")
    if unit_m is not None and not 1e-6 <= unit_m <= 1.0:
        raise UsageError(f"--depth-unit {unit_m} m: expected 0.000001 to 1")

    def say(text: str) -> None:
        _say_doubt(file, text)

    doubt = ""
    if image.dtype.kind == "f":
        depth_m = depth_of_metres(image * (1.0 if unit_m is None else unit_m), say)
        step = "its numbers have decimals, and nothing says their unit: metres are taken"
    else:
        # The largest signed number is no more a measurement than the largest of 16 bits.
        steps = (
            np.where(image == np.iinfo(np.int16).max, 0, image)
            if image.dtype.kind == "i"
            else image
        )
        depth_m = depth_of_steps(steps, 0.001 if unit_m is None else unit_m, say)
        # Who names the unit knows it.
        doubt = doubtful_steps(steps) if unit_m is None else ""
        step = "nothing says the unit of its depth: steps of 1 mm are taken"
    doubt = implausible_depth(depth_m) or doubt
    if unit_m is not None:
        say(doubt)
    elif doubt:
        say(f"{doubt} --depth-unit says it")
    else:
        _say_doubt(file, f"{step}; --depth-unit says it", is_once=True)
    return depth_m


def _with_colour(
    file: Path,
    data: bytes,
    depth_m: NDArray[np.float32],
    view: View,
    cameras: Cameras,
    limits: Limits,
) -> Frame:
    import numpy as np

    from features.codec.image_header import stored_orientation
    from features.geometry import Frame
    from features.imaging.camera import align_colour, undistorted

    _, straight = undistorted(cameras.depth, None, depth_m)
    assert straight is not None
    camera = cameras.depth.intrinsics
    turned = stored_orientation(data)
    if view.colour is None:
        _say_doubt(file, _turn(turned))
        return Frame(straight, camera)
    coded = bytes_of(view.colour, limits.stored_bytes)
    rgb = read_image(view.colour, coded, limits)
    if stored_orientation(coded) != turned:
        # As cameras write them: their numbers describe the sensor, however it was held.
        _say_doubt(file, _turn(turned))
        _say_doubt(view.colour, _turn(stored_orientation(coded)))
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


def _turn(orientation: int) -> str:
    """Return what is done about the orientation that EXIF gives a picture of a depth camera."""
    if orientation == 1:
        return ""
    return (
        f"its EXIF says that it is to be turned (orientation {orientation}): taken as it is "
        "stored, as the numbers of a camera mean it"
    )


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
    from features.codec.image_header import (
        image_size,
        is_cut_off,
        is_half_floats,
        more_pictures,
    )

    try:
        limits.check_image(*image_size(data))
    except CloudFormatError as error:
        raise DataError(f"{file}: {error}") from error
    if is_cut_off(data):
        raise DataError(f"{file}: the PNG is cut off")
    if is_half_floats(data):
        raise DataError(f"{file}: a TIFF of 16-bit numbers with decimals; save it with 32 bits")
    _say_doubt(file, more_pictures(data))
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DataError(f"{file}: the image does not decode ({error.err})") from None
    if image is None:
        raise DataError(f"{file}: the image does not decode")
    return np.asarray(image)


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
