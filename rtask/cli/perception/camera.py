"""``rtask camera``: check a camera's calibration against its depth, or estimate one."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import click

from rtask.cli.options import json_option, print_json
from rtask.cli.perception.camera_estimate import estimate
from rtask.cli.perception.scene_file import read_scene
from rtask.cli.perception.view_options import View, camera_options
from rtask.errors import DataError, UsageError

__all__ = ["camera"]

_MAX_SHIFT_PX, _MIN_GAIN = 2, 1.05
_MAX_REPROJECTION_PX, _MAX_SCALE = 1.0, 0.03


@click.command()
@click.argument(
    "files",
    nargs=-1,
    required=True,
    metavar="FILE...",
    type=click.Path(exists=True, path_type=Path),
)
@camera_options
@click.option(
    "--board",
    nargs=2,
    type=click.IntRange(3),
    metavar="N M",
    help="Inner corners of a printed chessboard in view, along either side.",
)
@click.option("--square", type=click.FloatRange(0.001, 1), help="Side of its squares, m.")
@click.option(
    "--estimate",
    "out",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="OUT",
    help="Write the camera of the pictures FILE... of the board as JSON for --camera.",
)
@click.option(
    "--depths",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    metavar="FOLDER",
    help="With --estimate: depth images of the same names, for the place of their camera.",
)
@json_option
def camera(
    files: tuple[Path, ...], view: View, board: tuple[int, int] | None, square: float | None,
    out: Path | None, depths: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Check a camera's calibration against its depth, or estimate it. Exit code 1 if it is off.

    FILE is a depth image with --colour, a recording or a crop, of things that stand before others:
    colours must end where depth does. With --board and --square, a printed chessboard must be as
    far and as large in depth as in the picture.

    With --estimate, FILE... are pictures of the board in at least six postures, tilted to each
    side, near and far. --depths adds the place of a depth camera, which --focal or --camera
    describes.
    """
    if (board is None) != (square is None):
        raise UsageError("--board and --square belong together")
    if view.frame:
        raise UsageError("--frame: no use here, where the camera stands does not matter")
    if out is not None:
        if board is None or square is None:
            raise UsageError("--estimate needs the board: --board and --square")
        estimate(files, view, (*board, square), out, depths, as_json=as_json)
        return
    if depths is not None:
        raise UsageError("--depths belongs to --estimate")
    if len(files) > 1:
        raise UsageError("one FILE is checked at a time; several belong to --estimate")
    _check(files[0], view, board, square, as_json=as_json)


def _check(
    file: Path, view: View, board: tuple[int, int] | None, square: float | None, *, as_json: bool
) -> None:
    from features.geometry import Frame
    from features.imaging.calibration import check_board, registration_shift

    # A board is as large in the picture as the focal length makes it: a guess measures nothing.
    seen = read_scene(file, replace(view, is_stored=board is not None))
    if not isinstance(seen, Frame):
        raise UsageError(f"{file} is a cloud; the calibration shows in images of depth and colour")
    output: dict[str, object] = {}
    faults: list[str] = []
    try:
        shift = registration_shift(seen)
        output["registration"] = asdict(shift)
        off = max(abs(shift.right_px), abs(shift.down_px))
        if off > _MAX_SHIFT_PX and shift.gain > _MIN_GAIN:
            faults.append(
                f"colours lie {shift.right_px:+d} px right and {shift.down_px:+d} px below depth"
            )
        if board is not None and square is not None:
            checked = check_board(seen, (max(board), min(board)), square)
            output["board"] = asdict(checked)
            if checked.reprojection_px > _MAX_REPROJECTION_PX:
                faults.append(f"corners are {checked.reprojection_px:.1f} px off: lens or focal")
            if abs(checked.depth_scale - 1) > _MAX_SCALE:
                faults.append(f"depth is {checked.depth_scale:.3f} times what the board says")
    except ValueError as error:
        raise DataError(f"{file}: {error}") from error
    output["faults"] = faults
    if as_json:
        print_json(output)
    else:
        for name, values in output.items():
            if isinstance(values, dict):
                click.echo(f"{name}: " + ", ".join(f"{k} {v:.4g}" for k, v in values.items()))
        for fault in faults or ["the calibration fits"]:
            click.echo(fault)
    if faults:
        raise click.exceptions.Exit(1)
