"""``rtask recognise``: recognise the known objects in a view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import connection, open_to_read
from rtask.cli.options import (
    announce_why_stated,
    data_option,
    exit_if_empty,
    json_option,
    print_json,
    server_option,
)
from rtask.cli.perception.cutting import segmentation_option
from rtask.cli.perception.scene_file import save_picture
from rtask.cli.perception.selecting import selection_options
from rtask.cli.perception.view_options import View, camera_options
from rtask.cli.progress import Working, announce_compilation
from rtask.engine.words import contradiction_words
from rtask.errors import UsageError

if TYPE_CHECKING:
    from features.geometry import Frame
    from rtask.cli.perception.recognition import Seen
    from rtask.engine.perception.poses import ObjectPose

__all__ = ["recognise"]

_SHOWN = 3
_VERDICTS = {
    "null": "no known object",
    "single": "one known object",
    "multiple": "more than one object fits",
}


@click.command()
@click.argument("file", type=click.Path(exists=True, path_type=Path))
@data_option
@server_option
@camera_options
@selection_options
@segmentation_option
@click.option(
    "--min-confidence",
    type=click.FloatRange(0, 1),
    help="Lowest confidence of an accepted answer.  [default: 0.7]",
)
@click.option(
    "--look",
    "looks",
    multiple=True,
    type=click.Path(exists=True, path_type=Path),
    help="Another view of the one object in FILE, of the same kind of file; may be repeated.",
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
    server: str | None,
    view: View,
    mask: Path | None,
    box: tuple[float, float, float, float] | None,
    preset: str,
    min_confidence: float | None,
    looks: tuple[Path, ...],
    save_plot: Path | None,
    as_json: bool,
) -> None:
    """Recognise the known objects in a view. Exit code 1 if none is recognised.

    FILE is a photograph, a 16-bit depth image with its colour image as --colour, an organised cloud
    with colours (PCD or PLY), a recording (.bag, .mcap, or the folder of one), or the crop of one
    object in the format that robots send. A view with depth is cut into objects; in a photograph
    the object is what differs from the rim, unless --box or --mask say where it is. Nothing is
    written to the knowledge base.
    """
    from rtask.cli.perception.selecting import Selection, objects_in

    with announce_compilation(), Working("recognising"):
        frame, crops = objects_in(file, view, preset, Selection(mask, box))
        further = [_further(look_, view, preset) for look_ in looks]
        if further and len(crops) != 1:
            raise UsageError(
                f"{file} shows {len(crops)} objects: --look is for one; point at it with --box"
            )
        if server:
            if save_plot is not None:
                raise UsageError("--save-plot needs the stored views: it goes with --data alone")
            rows = _asked(server, crops, min_confidence, further)
        else:
            rows = _recognised(data, frame, crops, min_confidence, further, save_plot)
    recognised = sum(row["accepted"] for row in rows)
    if as_json:
        print_json(rows)
        exit_if_empty(recognised)
        return
    click.echo(f"{len(rows)} object{'' if len(rows) == 1 else 's'} seen, {recognised} recognised")
    for row in rows:
        verdict = _VERDICTS[row["outcome"]] + (", accepted" if row["accepted"] else "")
        if row["family"]:
            verdict = f"looks like a known object, but {_difference(row)}"
        elif row["ask_again"]:
            verdict += ", another view may decide"
            if row["in_other_light"]:
                verdict += "; the light differs: `rtask teach` a view in this light"
        elif row["outcome"] == "null" and row["views_untried"]:
            verdict += f", not decided: {row['views_untried']} stored views that share its print "
            verdict += "were left out; another view may decide"
        if not row["accepted"]:
            verdict = "; ".join((verdict, *row["lacks"]))
        verdict += row["beside"]
        pose = row["pose"]
        if pose is not None:
            verdict += f", pose {pose['confidence']:.2f}"
            verdict += "" if pose["accepted"] else " (cannot be determined)"
        click.echo(f"{row['label']:4d}  {verdict}")
        for match in row["matches"][:_SHOWN]:
            evidence = ""
            if "inliers" in match:
                evidence = f"  {match['inliers']} inliers, appearance {match['appearance']:.2f}"
            click.echo(
                f"      {match['confidence']:.2f}  {match['name']}  {match['object']}{evidence}"
            )
        left_out = len(row["matches"]) - _SHOWN
        if left_out > 0:
            click.echo(f"      {left_out} more that it is like; --json lists them")
    _announce_why(rows, server, has_plot=save_plot is not None)
    exit_if_empty(recognised)


def _difference(row: Mapping[str, Any]) -> str:
    """Return by what a view differs from the object of its family, in words."""
    if row["word_seen"]:
        return contradiction_words(row["word_seen"], row["word_stored"], "that")
    return f"differs {row['differs']}"


def _announce_why(rows: Sequence[Mapping[str, Any]], server: str | None, *, has_plot: bool) -> None:
    """Print how to see what the confidences rest on: a picture, or the view that agrees."""
    views = [match["view"] for row in rows for match in row["matches"]]
    if views and server:
        announce_why_stated(views[0])
    elif views and not has_plot:
        click.echo("why: the same call with --save-plot FILE draws what agrees", err=True)


def _further(file: Path, view: View, preset: str) -> Frame:
    """Return the crop of the one object in another view."""
    from rtask.cli.perception.selecting import Selection, objects_in

    _, crops = objects_in(file, view, preset, Selection())
    if len(crops) != 1:
        raise UsageError(f"--look {file} shows {len(crops)} objects, where one is expected")
    return crops[0][1]


def _recognised(
    data: Path,
    frame: Frame,
    crops: list[tuple[int, Frame]],
    min_confidence: float | None,
    further: list[Frame],
    save_plot: Path | None,
) -> list[dict[str, Any]]:
    """Recognise the objects by the views of a folder."""
    from rtask.cli.perception.pictures import recognition_picture
    from rtask.cli.perception.recognition import index_of, look, with_pose
    from rtask.engine.networks.printed_words import PrintedWords, reader_by_environment
    from rtask.engine.stored import Models

    with open_to_read(data) as kb:
        index, reader = index_of(kb), reader_by_environment()
        models, words = Models(kb), None if reader is None else PrintedWords(kb, reader)
        answers = look(crops, index, min_confidence, further, words)
        seen = [with_pose(models, view) for view in answers]
        if save_plot is not None:
            save_picture(save_plot, recognition_picture(models, frame, seen))
        index.close()
    return [_row(view) for view in seen]


def _asked(
    server: str,
    crops: list[tuple[int, Frame]],
    min_confidence: float | None,
    further: list[Frame],
) -> list[dict[str, Any]]:
    """Ask a server about each object."""
    from features.codec import encode_frame
    from features.imaging.exposure import lacking

    rows = []
    with connection(Path(), server) as client:
        for label, crop in crops:
            answer = client.call(
                "search_object",
                data=encode_frame(crop),
                min_confidence=min_confidence,
                looks=[{"data": encode_frame(look)} for look in further],
            )
            rows.append(
                {
                    "label": label,
                    "box_px": [crop.x0, crop.y0, *crop.depth_m.shape[::-1]],
                    "outcome": answer["outcome"],
                    "accepted": answer["accepted"],
                    "family": answer["family"],
                    "differs": answer["differs"],
                    # A server of an earlier version reads no words.
                    "word_seen": answer.get("word_seen", ""),
                    "word_stored": answer.get("word_stored", ""),
                    "ask_again": answer["ask_again"],
                    "in_other_light": answer["in_other_light"],
                    "views_untried": answer["views_untried"],
                    "beside": _beside(answer),
                    "lacks": [] if crop.rgb is None else list(lacking(crop.rgb)),
                    "pose": None,
                    "matches": [
                        {
                            "object": similar["object"],
                            "name": similar["label"],
                            "class": similar["class_iri"],
                            "view": similar["view"],
                            "confidence": round(similar["confidence"], 4),
                        }
                        for similar in answer["similar_objects"]
                    ],
                }
            )
    return rows


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


def _beside(answer: Mapping[str, Any]) -> str:
    """Return what a server says of another thing in the picture."""
    from rtask.engine.perception.identity import NEIGHBOUR

    # A server of an earlier version names one thing only.
    _, mark, beside = answer.get("message", "").partition(f"; {NEIGHBOUR}")
    return f"{mark}{beside.partition(';')[0]}"


def _row(view: Seen) -> dict[str, Any]:
    from features.imaging.exposure import lacking
    from rtask.engine.perception.identity import neighbour_words

    return {
        "label": view.label,
        "box_px": [view.crop.x0, view.crop.y0, *view.crop.depth_m.shape[::-1]],
        "keypoints": len(view.features),
        "outcome": view.answer.outcome,
        "accepted": view.answer.accepted,
        "family": view.answer.family,
        "differs": view.answer.differs,
        "word_seen": "" if view.answer.words is None else view.answer.words.seen.text,
        "word_stored": "" if view.answer.words is None else view.answer.words.stored.text,
        "ask_again": view.answer.ask_again,
        "in_other_light": view.answer.is_in_other_light,
        "views_untried": view.answer.views_untried,
        "beside": neighbour_words(view.answer, view.names),
        "lacks": [] if view.crop.rgb is None else list(lacking(view.crop.rgb)),
        "pose": _pose_row(view.pose),
        "matches": [
            {
                "object": match.object_iri,
                "name": view.names.get(match.object_iri, ""),
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
            for match in view.answer.matches
        ],
    }
