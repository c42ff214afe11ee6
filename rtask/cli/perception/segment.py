"""``rtask segment``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import json_option, print_json
from rtask.cli.perception.scene_file import View, camera_options, read_scene, save_picture
from rtask.errors import DataError, UsageError

if TYPE_CHECKING:
    from features.codec.types import Cloud
    from features.geometry import Frame
    from features.segmentation import Scene, SegmentParams

__all__ = ["cut", "segment"]

PRESETS = ("auto", "default", "near", "concave", "components", "euclidean")


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@camera_options
@click.option(
    "--preset",
    type=click.Choice(PRESETS),
    default="auto",
    show_default=True,
    help="How to cut; auto chooses by the distance of the table.",
)
@click.option("--min-points", type=click.IntRange(1), help="Smaller segments are dropped.")
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
    colour: Path | None,
    depth_unit: float,
    focal: float | None,
    centre: tuple[float, float] | None,
    preset: str,
    min_points: int | None,
    labels_file: Path | None,
    save_plot: Path | None,
    as_json: bool,
) -> None:
    """Cut a view of a table into objects.

    FILE is a cloud (PLY or PCD), a crop as robots send it, or a 16-bit depth image, with --colour
    for its colours. Clouds are in metres, in the frame of the camera: x right, y down, z forward.
    """
    _check_outputs(file, colour, labels_file, save_plot)
    seen = read_scene(file, View(colour, depth_unit, focal, centre))
    try:
        scene = cut(seen, preset, min_points)
    except DataError as error:
        raise DataError(f"{file}: {error}; --depth-unit is one step of a depth image") from error
    if labels_file is not None:
        _write_labels(labels_file, scene)
    if save_plot is not None:
        from rtask.cli.perception.segment_picture import picture

        save_picture(save_plot, picture(seen, scene))
    if as_json:
        print_json({"status": scene.status, "objects": [_row(thing) for thing in scene.objects]})
        return
    click.echo(f"{scene.status}: {len(scene.objects)} objects")
    for thing in scene.objects:
        row = _row(thing)
        x, y, z = row["centroid_m"]
        border = ", touches the border" if row["touches_border"] else ""
        click.echo(
            f"{row['label']:4d}  {row['points']:6d} points  at {x:+.3f} {y:+.3f} {z:.3f} m{border}"
        )


def cut(seen: Frame | Cloud, preset: str = "auto", min_points: int | None = None) -> Scene:
    """Segment what was read.

    Raises
    ------
    DataError
        When it is no view of anything: wrong units, too large.
    """
    from dataclasses import replace

    from features.geometry import Frame
    from features.segmentation import SegmentParams, segment_scene

    colours = seen.rgb if isinstance(seen, Frame) else seen.colours
    params = _params(preset)
    if min_points is not None:
        params = replace(params or SegmentParams(), min_points=min_points)
    try:
        return segment_scene(seen.points(), colours, params)
    except ValueError as error:
        raise DataError(str(error)) from error


def _params(preset: str) -> SegmentParams | None:
    from features.segmentation import SegmentParams

    known: dict[str, Any] = {
        "auto": lambda: None,
        "default": SegmentParams,
        "near": SegmentParams.near,
        "concave": lambda: SegmentParams(tolerance_deg=35, bad_sanity=0.10),
        "components": lambda: SegmentParams(method="components", tolerance_deg=12),
        "euclidean": lambda: SegmentParams(method="euclidean"),
    }
    params: SegmentParams | None = known[preset]()
    return params


def _row(thing: Any) -> dict[str, Any]:
    return {
        "label": thing.label,
        "points": len(thing.indices),
        "centroid_m": [round(float(c), 4) for c in thing.centroid],
        "box_m": [[round(float(c), 4) for c in corner] for corner in thing.box],
        "touches_border": thing.touches_border,
    }


def _check_outputs(
    file: Path, colour: Path | None, labels_file: Path | None, save_plot: Path | None
) -> None:
    """Refuse before any work what could not be written, or would overwrite what is read."""
    if labels_file is not None and labels_file.suffix not in (".npy", ".png"):
        raise UsageError(f"{labels_file}: labels are written as .png (of an image) or .npy")
    if save_plot is not None and save_plot.suffix not in (".png", ".jpg", ".jpeg", ""):
        raise UsageError(f"{save_plot}: cannot write pictures of this kind; use .png or .jpg")
    read = {path.resolve() for path in (file, colour) if path is not None}
    for written in (labels_file, save_plot):
        if written is None:
            continue
        if written.resolve() in read:
            raise UsageError(f"{written}: is read; write to another file")
        if not written.parent.is_dir():
            raise UsageError(f"{written}: there is no folder {written.parent}")
        read.add(written.resolve())


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
