"""``rtask segment``: cut a view of a table into objects."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import exit_if_empty, json_option, print_json
from rtask.cli.perception.cutting import segmentation_option
from rtask.cli.perception.posed import Posed, posed_view
from rtask.cli.perception.scene_file import read_scene, save_picture
from rtask.cli.perception.view_options import View, camera_options
from rtask.cli.progress import announce_compilation
from rtask.engine.perception.cutting import cut, cut_in_base, cut_together
from rtask.errors import DataError, UsageError

if TYPE_CHECKING:
    from features.segmentation import Scene

__all__ = ["segment"]


@click.command()
@click.argument("file", type=click.Path(exists=True, path_type=Path))
@camera_options
@segmentation_option
@click.option(
    "--also-at",
    "also_at",
    multiple=True,
    type=click.FloatRange(min=0),
    metavar="S",
    help="Of a recording with TF: the view at this time as well, cut together with that of --at; "
    "may be repeated.",
)
@click.option("--min-points", type=click.IntRange(1), help="Drop segments smaller than this.")
@click.option(
    "--labels",
    "labels_file",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write the label of every pixel (16-bit .png) or point (.npy).",
)
@click.option(
    "--save-plot",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a picture of the segments.",
)
@json_option
def segment(
    file: Path,
    view: View,
    preset: str,
    also_at: tuple[float, ...],
    min_points: int | None,
    labels_file: Path | None,
    save_plot: Path | None,
    as_json: bool,
) -> None:
    """Cut a view of a table into objects. Exit code 1 if there are none.

    FILE is a point cloud (PLY or PCD), a crop in the format that robots send, a recording (.bag,
    .mcap, or the folder of one), or a 16-bit depth image, with its colour image as --colour. Clouds
    are in m in the camera frame: x right, y down, z forward. Where the TF of a recording says where
    the camera was, the view is cut as a robot does, and places are in the robot's frame. Labels
    come one for each pixel or point of FILE, in its order and shape; with --also-at, of its view
    at --at.
    """
    _check_outputs(file, view.colour, labels_file, save_plot)
    seen = read_scene(file, view)
    try:
        posed = posed_view(file, view, seen, is_cut_as_usual=preset == "auto")
        with announce_compilation():
            if also_at:
                scene, table_height = _cut_with(file, view, posed, also_at, min_points)
            elif posed is None:
                scene, table_height = cut(seen, preset, min_points), None
            else:
                scene, table_height = cut_in_base(
                    posed.view, posed.base_from_camera, min_points or 1, posed.body
                )
    except DataError as error:
        raise DataError(
            f"{file}: {error}; is --depth-unit, the metres of one depth step, right?"
        ) from error
    if labels_file is not None:
        _write_labels(labels_file, scene)
    if save_plot is not None:
        from rtask.cli.perception.pictures import segments_picture

        save_picture(save_plot, segments_picture(seen, scene))
    if as_json:
        made: dict[str, Any] = {
            "status": scene.status,
            "objects": [_row(segment_) for segment_ in scene.objects],
        }
        if posed is not None:
            made |= {"frame": posed.base, "table_height_m": _height(table_height)}
        print_json(made)
        exit_if_empty(scene.objects)
        return
    where = "" if posed is None else f" in {posed.base}"
    if _height(table_height) is not None:
        where += f", table at {table_height:.3f} m"
    click.echo(f"{scene.status}: {len(scene.objects)} objects{where}")
    for segment_ in scene.objects:
        row = _row(segment_)
        x, y, z = row["centroid_m"]
        border = ", touches the border" if row["touches_border"] else ""
        click.echo(
            f"{row['label']:4d}  {row['points']:6d} points  at {x:+.3f} {y:+.3f} {z:.3f} m{border}"
        )
    exit_if_empty(scene.objects)


def _cut_with(
    file: Path, view: View, posed: Posed | None, also_at: tuple[float, ...], min_points: int | None
) -> tuple[Scene, float]:
    """Return what the views at several times show together, in the frame of the first.

    Raises
    ------
    UsageError
        TF does not say where the camera was at one of the times.
    """
    from features.segmentation import Scene

    if posed is None:
        raise UsageError("--also-at: needs a recording whose TF says where the camera was")
    views = [(posed.view, posed.base_from_camera)]
    for time_s in also_at:
        then = replace(view, at_s=time_s, frame=posed.base)
        other = posed_view(file, then, read_scene(file, then), is_cut_as_usual=True)
        if other is None:
            raise UsageError(f"--also-at {time_s:g}: no coloured view whose place TF says")
        views.append((other.view, other.base_from_camera))
    together = cut_together(views, min_points)
    scene = Scene(together.status, None, None, together.labels[0], together.objects)
    return scene, together.table_height


def _row(segment: Any) -> dict[str, Any]:
    return {
        "label": segment.label,
        "points": len(segment.indices),
        "centroid_m": [round(float(c), 4) for c in segment.centroid],
        "box_m": [[round(float(c), 4) for c in corner] for corner in segment.box],
        "touches_border": segment.touches_border,
    }


def _height(table_height: float | None) -> float | None:
    """Return the height of a table, m, or None where none was seen or nobody knows it."""
    return None if table_height is None or math.isnan(table_height) else round(table_height, 4)


def _check_outputs(
    file: Path, colour: Path | None, labels_file: Path | None, save_plot: Path | None
) -> None:
    """Refuse, before any work, outputs that cannot be written or would overwrite an input."""
    if labels_file is not None and labels_file.suffix not in (".npy", ".png"):
        raise UsageError(f"{labels_file}: labels are written as .png (of an image) or .npy")
    if save_plot is not None and save_plot.suffix not in (".png", ".jpg", ".jpeg", ""):
        raise UsageError(f"{save_plot}: unknown picture format; use .png or .jpg")
    inputs = {path.resolve() for path in (file, colour) if path is not None}
    outputs: set[Path] = set()
    for written in (labels_file, save_plot):
        if written is None:
            continue
        if written.resolve() in inputs:
            raise UsageError(f"{written} is an input; write to another file")
        if written.resolve() in outputs:
            raise UsageError(f"{written} would be written twice; name two files")
        if not written.parent.is_dir():
            raise UsageError(f"{written}: there is no folder {written.parent}")
        outputs.add(written.resolve())


def _write_labels(file: Path, scene: Scene) -> None:
    import io

    import cv2
    import numpy as np

    if file.suffix == ".npy":
        buffer = io.BytesIO()
        np.save(buffer, scene.labels)
        data = buffer.getvalue()
    elif scene.labels.ndim == 2:
        data = cv2.imencode(".png", scene.labels.astype(np.uint16))[1].tobytes()
    else:
        raise UsageError(f"{file}: labels of a cloud without pixels are written as .npy")
    try:
        file.write_bytes(data)
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from error
