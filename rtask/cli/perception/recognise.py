"""``rtask recognise``: recognise the known objects in a view."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import open_to_read
from rtask.cli.options import data_option, exit_if_empty, json_option, print_json
from rtask.cli.perception.cutting import segmentation_option
from rtask.cli.perception.scene_file import View, camera_options, read_scene, save_picture
from rtask.cli.progress import Working, announce_compilation
from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.cli.perception.recognition import Seen
    from rtask.engine.perception.poses import ObjectPose

__all__ = ["recognise"]

_VERDICTS = {
    "null": "no known object",
    "single": "one known object",
    "multiple": "more than one object fits",
}


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@data_option
@camera_options
@segmentation_option
@click.option(
    "--min-confidence",
    type=click.FloatRange(0, 1),
    help="Lowest confidence of an accepted answer.  [default: 0.7]",
)
@click.option(
    "--save-plot",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a picture with names, poses, and matches with their inliers.",
)
@json_option
def recognise(
    file: Path,
    data: Path,
    colour: Path | None,
    depth_unit: float,
    focal: float | None,
    centre: tuple[float, float] | None,
    preset: str,
    min_confidence: float | None,
    save_plot: Path | None,
    as_json: bool,
) -> None:
    """Recognise the known objects in a view. Exit code 1 if none is recognised.

    FILE is the crop of one object in the format that robots send, or a 16-bit depth image with its
    colour image as --colour, which is cut into objects first. Nothing is written to the knowledge
    base.
    """
    from features.geometry import Frame
    from rtask.cli.perception.pictures import recognition_picture
    from rtask.cli.perception.recognition import index_of, look, with_pose
    from rtask.engine.stored import Models

    frame = read_scene(file, View(colour, depth_unit, focal, centre))
    if not isinstance(frame, Frame):
        raise UsageError(
            f"{file} is a cloud without an image, which recognition needs; "
            "give a depth image and --colour, or a crop in the format that robots send"
        )
    if frame.rgb is None:
        raise UsageError(f"{file}: recognition needs colours; give the colour image as --colour")
    with announce_compilation(), Working("recognising"), open_to_read(data) as kb:
        index = index_of(kb)
        models = Models(kb)
        seen = [with_pose(models, one) for one in look(frame, index, preset, min_confidence)]
        if save_plot is not None:
            save_picture(save_plot, recognition_picture(models, frame, seen))
        index.close()
    rows = [_row(one) for one in seen]
    recognised = sum(row["accepted"] for row in rows)
    if as_json:
        print_json(rows)
        exit_if_empty(recognised)
        return
    click.echo(f"{len(rows)} objects seen, {recognised} recognised")
    for row in rows:
        verdict = _VERDICTS[row["outcome"]] + (", accepted" if row["accepted"] else "")
        pose = row["pose"]
        if pose is not None:
            verdict += f", pose {pose['confidence']:.2f}"
            verdict += "" if pose["accepted"] else " (cannot be determined)"
        click.echo(f"{row['label']:4d}  {verdict}")
        for match in row["matches"][:3]:
            click.echo(
                f"      {match['confidence']:.2f}  {match['object']}  "
                f"{match['inliers']} inliers, appearance {match['appearance']:.2f}"
            )
    exit_if_empty(recognised)


def _pose_row(pose: ObjectPose | None) -> dict[str, Any] | None:
    if pose is None:
        return None
    return {
        "confidence": round(pose.confidence, 4),
        "accepted": pose.accepted,
        "ambiguous": pose.estimate.ambiguous,
        "source": pose.source,
        "views": pose.views,
        "camera_from_object": pose.camera_from_object.round(5).tolist(),
    }


def _row(one: Seen) -> dict[str, Any]:
    return {
        "label": one.label,
        "box_px": [one.crop.x0, one.crop.y0, *one.crop.depth_m.shape[::-1]],
        "keypoints": len(one.features),
        "outcome": one.answer.outcome,
        "accepted": one.answer.accepted,
        "pose": _pose_row(one.pose),
        "matches": [
            {
                "object": match.object_iri,
                "class": match.class_iri,
                "view": match.view_iri,
                "confidence": round(float(match.confidence), 4),
                "inliers": match.inliers,
                "appearance": round(float(match.appearance), 4),
                "size_ok": match.size_ok,
                "query_from_view": None
                if match.query_from_view is None
                else match.query_from_view.round(5).tolist(),
            }
            for match in one.answer.matches
        ],
    }
