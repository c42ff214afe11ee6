"""The estimate of ``rtask camera``: from pictures of a chessboard to a file for ``--camera``."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import print_json
from rtask.cli.perception.scene_file import read_depth, read_image
from rtask.cli.perception.view_options import View, read_cameras
from rtask.errors import DataError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.imaging.camera import Lens
    from features.imaging.estimation import EstimatedLens, EstimatedPlace

__all__ = ["estimate"]

_MAX_SCALE_OFF = 0.03
_MIN_REACH = 0.85
"""Of the way to the corners: the sides of a picture of 4:3 are at .8 of it."""


def estimate(
    files: Sequence[Path], view: View, board: tuple[int, int, float], out: Path,
    depths: Path | None, *, as_json: bool,
) -> None:  # fmt: skip
    """Write the camera that took pictures of a chessboard, and say what it is worth.

    Parameters
    ----------
    board
        Inner corners along either side, and the side of a square, m.
    depths
        Folder with depth images of the same names.

    Raises
    ------
    UsageError
        Options that have no use here, or a depth camera that nobody describes.
    DataError
        The pictures do not determine a camera, or one does not read.
    """
    from features.imaging.estimation import Board, estimate_lens, estimate_place

    _refuse_options(view, depths)
    pattern = Board(max(board[:2]), min(board[:2]), board[2])
    try:
        estimated = estimate_lens([_grey(file) for file in files], pattern)
        place, lens = None, None
        if depths is not None:
            images = [_depth(depths, file, view) for file in files]
            cameras = read_cameras(images[0].shape, view)
            for note in cameras.notes:
                click.echo(f"{depths}: {note}", err=True)
            lens = cameras.depth
            place = estimate_place(estimated.poses, pattern, images, lens)
    except ValueError as error:
        raise DataError(f"{files[0].parent}: {error}") from error
    written: dict[str, Any] = _fields(estimated.lens)
    if place is not None and lens is not None:
        written = {
            "depth": _fields(lens),
            "colour": written,
            "colour_from_depth": place.colour_from_depth.tolist(),
        }
    try:
        out.write_text(json.dumps(written, indent=2) + "\n")
    except OSError as error:
        raise UsageError(f"{out}: {error.strerror}") from error
    _say(estimated, place, files, out, as_json=as_json)


def _refuse_options(view: View, depths: Path | None) -> None:
    usable = (
        ("--depth-unit", "--focal", "--focal-y", "--centre", "--distortion", "--camera")
        if depths is not None
        else ()
    )
    without = [name for name in view.given if name not in usable]
    if without:
        raise UsageError(f"{' and '.join(without)}: no use with --estimate, which finds it")
    if depths is not None and view.focal is None and view.camera is None:
        raise UsageError("--depths: --focal or --camera must describe the depth camera")


def _grey(file: Path) -> NDArray[np.uint8]:
    import cv2
    import numpy as np

    from features.codec.limits import Limits

    image = read_image(file, _bytes(file), Limits())
    if image.dtype != np.uint8:
        raise ValueError(f"{file.name} has {image.dtype.itemsize * 8} bits a channel; expected 8")
    return np.asarray(
        image if image.ndim == 2 else cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2GRAY), np.uint8
    )


def _depth(folder: Path, file: Path, view: View) -> NDArray[np.float32]:
    """Return the depth, m, of the image of the same name in a folder, whatever its suffix."""
    from features.codec.limits import Limits

    beside = sorted(path for path in folder.iterdir() if path.stem == file.stem)
    if len(beside) != 1:
        raise ValueError(f"{len(beside)} files named {file.stem} in {folder}; one is expected")
    image = read_image(beside[0], _bytes(beside[0]), Limits())
    return read_depth(beside[0], image, view.depth_unit_m)


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from error


def _fields(lens: Lens) -> dict[str, Any]:
    """Return a lens by the plain names that ``--camera`` reads."""
    camera = lens.intrinsics
    names = ("width", "height", "fx", "fy", "cx", "cy")
    fields: dict[str, Any] = {name: getattr(camera, name) for name in names}
    fields["distortion"] = list(lens.distortion)
    if lens.is_fisheye:
        fields["distortion_model"] = "equidistant"
    return fields


def _say(
    estimated: EstimatedLens, place: EstimatedPlace | None, files: Sequence[Path], out: Path, *,
    as_json: bool,
) -> None:  # fmt: skip
    unused = [file.name for k, file in enumerate(files) if k not in estimated.poses]
    camera = estimated.lens.intrinsics
    report: dict[str, Any] = {
        "file": str(out), "pictures": len(estimated.poses), "left_out": unused,
        "reprojection_px": estimated.reprojection_px, "focal_error_px": estimated.focal_error_px,
        "centre_error_px": estimated.centre_error_px, "reach": estimated.reach,
    }  # fmt: skip
    place_error_m = 0.0
    if place is not None:
        place_error_m = math.hypot(place.place_error_m, estimated.board_error_m)
        report |= {
            "depth_views": place.views, "place_error_m": place_error_m,
            "depth_scale": place.depth_scale, "residual_m": place.residual_m,
        }  # fmt: skip
    if as_json:
        print_json(report)
        return
    click.echo(
        f"focal {camera.fx:.1f} {camera.fy:.1f} px (+-{estimated.focal_error_px:.1f}), centre "
        f"{camera.cx:.1f} {camera.cy:.1f} px (+-{estimated.centre_error_px:.1f}), corners "
        f"{estimated.reprojection_px:.2f} px off in {len(estimated.poses)} of {len(files)} pictures"
    )
    if estimated.reach < _MIN_REACH:
        click.echo(
            f"the boards reach {estimated.reach:.0%} of the way to the corners of the picture: "
            "beyond, the distortion is a guess; show the board there as well"
        )
    if unused:
        click.echo(f"without a board that fits: {', '.join(unused)}")
    if place is not None:
        right, down, forth = 1000 * place.colour_from_depth[:3, 3]
        click.echo(
            f"depth camera at {right:.1f} {down:.1f} {forth:.1f} mm of the colour camera "
            f"(+-{1000 * place_error_m:.1f}), by {place.views} boards"
        )
        if abs(place.depth_scale - 1) > _MAX_SCALE_OFF:
            # A square of another size than was said changes distances, and nothing of the lens.
            click.echo(
                f"depth is {place.depth_scale:.3f} times what the board says: are its squares as "
                "large as was said?"
            )
    click.echo(f"written to {out}; give it as --camera")
