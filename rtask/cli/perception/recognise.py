"""``rtask recognise``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import data_option, json_option, open_to_read, print_json
from rtask.cli.perception.scene_file import View, camera_options, read_scene, save_picture
from rtask.cli.perception.segment import PRESETS, cut
from rtask.errors import MissingBlobError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.geometry import Frame
    from features.recognition import Match, RecognitionIndex, ViewFeatures
    from features.recognition import Recognition as Answer
    from rtask.engine.perception.poses import ObjectPose
    from rtask.engine.stored import Models
    from rtask.kb.core import GraphCore
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["recognise"]

_MOST_PLOTTED, _LEAST_ROWS = 6, 360
_VERDICTS = {
    "null": "no known object",
    "single": "one known object",
    "multiple": "more than one object fits",
}


@dataclass(frozen=True)
class Seen:
    """One object of the view, described and recognised."""

    label: int
    crop: Frame
    features: ViewFeatures
    answer: Answer
    pose: ObjectPose | None = None

    @property
    def name(self) -> str:
        """Short name of what it is, of the two that it may be, or a question mark."""
        if self.answer.outcome == "multiple" and not self.answer.accepted:
            both = " or ".join(_short(match.object_iri) for match in self.answer.matches[:2])
            return f"{self.label}: {both}?"
        if not self.answer.accepted:
            return f"{self.label}: ?"
        first = self.answer.matches[0]
        name = f"{self.label}: {_short(first.object_iri)} {first.confidence:.2f}"
        return name if self.pose is None else f"{name}, pose {self.pose.confidence:.2f}"


@click.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@data_option
@camera_options
@click.option("--preset", type=click.Choice(PRESETS), default="auto", help="How to cut the view.")
@click.option(
    "--min-confidence",
    type=click.FloatRange(0, 1),
    help="Least confidence of an accepted answer.  [default: 0.7]",
)
@click.option(
    "--save-plot",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a picture: names over the segments, matches with inliers, poses.",
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
    """Say which known objects a view shows.

    FILE is one object's crop as robots send it, or a 16-bit depth image with --colour, which is cut
    into objects first. Nothing is written to the knowledge base.
    """
    from features.geometry import Frame
    from rtask.engine.stored import Models

    frame = read_scene(file, View(colour, depth_unit, focal, centre))
    if not isinstance(frame, Frame):
        raise UsageError(
            f"{file} is a cloud without an image, which recognition needs; "
            "give a depth image and --colour, or a crop as robots send it"
        )
    if frame.rgb is None:
        raise UsageError(f"{file}: recognition needs colours; give the picture as --colour")
    with open_to_read(data) as kb:
        index = _index_of(kb)
        models = Models(kb)
        seen = [_posed(models, one) for one in _look(frame, index, preset, min_confidence)]
        if save_plot is not None:
            save_picture(save_plot, _picture(models, frame, seen))
        index.close()
    rows = [_row(one) for one in seen]
    if as_json:
        print_json(rows)
        return
    click.echo(f"{len(rows)} objects seen, {sum(row['accepted'] for row in rows)} recognised")
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


def _index_of(kb: KnowledgeBase) -> RecognitionIndex:
    """Return an index in memory, made from the graph: whoever serves it keeps the one on disk."""
    from features.recognition import RecognitionIndex
    from rtask.engine.stored import stored_views

    index = RecognitionIndex()
    for row in stored_views(kb):
        features = row.features(kb)
        if features is not None:
            index.add(row.view, row.object, row.class_iri, features)
    index.save()
    return index


def _look(
    frame: Frame, index: RecognitionIndex, preset: str, min_confidence: float | None
) -> list[Seen]:
    from features.recognition import Recogniser, describe_frame
    from rtask.engine.perception.identity import has_rivals
    from rtask.engine.policy import Policy

    recogniser = Recogniser(index)
    # What is known alone resembles nothing else: then the engine asks for more, and so do we.
    least = 0 if has_rivals(index) else Policy().inliers_when_alone
    crops: list[tuple[int, Frame]] = []
    if frame.mask is not None:
        crops.append((1, frame))
    else:
        scene = cut(frame, preset)
        crops += [(thing.label, frame.crop(scene.labels == thing.label)) for thing in scene.objects]
    seen = []
    for label, crop in crops:
        features = describe_frame(crop)
        answer = recogniser.recognise(features, min_confidence=min_confidence)
        if answer.accepted and answer.matches[0].inliers < least:
            answer = replace(answer, accepted=False)
        seen.append(Seen(label, crop, features, answer))
    return seen


def _posed(models: Models, one: Seen) -> Seen:
    """Return what was seen, with the pose where something stored can tell."""
    import numpy as np

    from rtask.engine.memory.question import Question
    from rtask.engine.memory.recall import recall
    from rtask.engine.observation import Observation
    from rtask.engine.perception.poses import find_pose

    if not one.answer.accepted:
        return one
    match = one.answer.matches[0]
    memory = recall(models.kb, Question(objects=(match.object_iri,), views=(match.view_iri,)))
    # Only the camera is known: not how it stands to the table.
    nothing = np.empty((0, 3))
    seen = Observation(b"", one.crop, one.features, np.eye(4), nothing, None, is_posed=False)
    known = memory.objects.get(match.object_iri)
    return replace(one, pose=find_pose(models, seen, known, match, memory))


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


def _short(name: str) -> str:
    return "/".join(name.rstrip("/").split("/")[-2:])


# ---- pictures -----------------------------------------------------------------------------------


def _picture(models: Models, frame: Frame, seen: list[Seen]) -> NDArray[np.uint8]:
    """Return names and poses over the view, and under it the matches of what was recognised."""
    import numpy as np

    from features.pictures import draw_labels

    labels = np.zeros(frame.depth_m.shape, np.int32)
    for one in seen:
        top, left = one.crop.y0 - frame.y0, one.crop.x0 - frame.x0
        height, width = one.crop.depth_m.shape
        labels[top : top + height, left : left + width][one.crop.object_mask()] = one.label
    times = max(1, _LEAST_ROWS // len(labels))
    frame, labels = _magnified(frame, times), np.kron(labels, np.ones((times, times), np.int32))
    assert frame.rgb is not None
    overlay = draw_labels(frame.rgb, labels, {one.label: one.name for one in seen})
    pictures = []
    for one in seen:
        for rank, match in enumerate(one.answer.matches[: _shown(one.answer)]):
            stored = _stored_view(models.kb, match.view_iri)
            if rank == 0 and one.answer.accepted:
                overlay = _with_pose(overlay, frame, models, one, stored)
            if stored is not None:
                pictures.append(_matches(one, match, *stored))
    return _stack([overlay, *pictures[:_MOST_PLOTTED]])


def _shown(answer: Answer) -> int:
    """Return how many matches are drawn: two that compete, else the first if anything agrees."""
    if answer.outcome == "multiple":
        return 2
    return int(answer.accepted or any(match.inliers for match in answer.matches[:1]))


def _magnified(frame: Frame, times: int) -> Frame:
    """Return a frame with so many times the rows: lines and names need room on a small crop."""
    lens, middle = frame.intrinsics, (times - 1) / 2
    lens = replace(
        lens, width=times * lens.width, height=times * lens.height, fx=times * lens.fx,
        fy=times * lens.fy, cx=times * lens.cx + middle, cy=times * lens.cy + middle,
    )  # fmt: skip

    def larger(pixels: NDArray[Any]) -> NDArray[Any]:
        return pixels.repeat(times, axis=0).repeat(times, axis=1)

    assert frame.rgb is not None
    return replace(
        frame, depth_m=larger(frame.depth_m), intrinsics=lens, rgb=larger(frame.rgb),
        mask=None, x0=times * frame.x0, y0=times * frame.y0,
    )  # fmt: skip


def _stored_view(kb: GraphCore, view: str) -> tuple[Frame, ViewFeatures] | None:
    """Return crop and features of a stored view, or None when its bytes are gone."""
    from features.codec import CloudFormatError, decode
    from features.geometry import Frame
    from features.recognition import ViewFeatures
    from rtask.rdf.namespaces import PREFIXES

    blobs: dict[str, str] = {}
    text = f"""{PREFIXES}
SELECT ?kind ?blob WHERE {{ <{view}> rt:viewContent ?content . ?content a ?kind ; rt:hasBlob ?blob
  FILTER(?kind IN (rt:CompressedPointCloud, rt:SIFTFeatureSet)) }}"""
    for row in kb.select(text):
        blobs[str(row.value("kind")).rpartition("#")[2]] = str(row.value("blob"))
    try:
        crop = decode(kb.blobs.read(blobs["CompressedPointCloud"]))
        features = ViewFeatures.from_bytes(kb.blobs.read(blobs["SIFTFeatureSet"]))
    except (KeyError, MissingBlobError, CloudFormatError, ValueError):
        return None
    return (crop, features) if isinstance(crop, Frame) and crop.rgb is not None else None


def _with_pose(
    overlay: NDArray[np.uint8],
    frame: Frame,
    models: Models,
    one: Seen,
    stored: tuple[Frame, ViewFeatures] | None,
) -> NDArray[np.uint8]:
    """Draw the posed model; without one the box of the stored view's points, carried over."""
    import numpy as np

    from features.pictures import draw_box, draw_model
    from rtask.rdf.terms import iri

    match = one.answer.matches[0]
    model = models.of(iri(match.object_iri))
    origin = (frame.x0, frame.y0)
    if one.pose is not None and model is not None:
        pose, cloud = one.pose.camera_from_object, model[1].cloud
        return draw_model(overlay, frame.intrinsics, pose, cloud, origin)
    if stored is None:
        return overlay
    points = stored[0].points().reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    if match.query_from_view is None or len(points) < 10:
        return overlay
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd((points - middle)[:: max(len(points) // 2000, 1)])
    axes[2] = np.cross(axes[0], axes[1])
    low, high = np.percentile((points - middle) @ axes.T, [2, 98], axis=0)
    box = np.eye(4)
    box[:3, :3], box[:3, 3] = axes.T, middle + (low + high) / 2 @ axes
    return draw_box(
        overlay,
        frame.intrinsics,
        match.query_from_view @ box,
        (high - low) / 2,
        origin,
    )


def _matches(one: Seen, match: Match, stored: Frame, features: ViewFeatures) -> NDArray[np.uint8]:
    from features.pictures import draw_matches
    from features.recognition.pairs import match_views

    assert one.crop.rgb is not None
    assert stored.rgb is not None
    pairs = match_views(one.features, features)
    verdict = "accepted" if one.answer.accepted else "not accepted"
    return draw_matches(
        one.crop.rgb,
        stored.rgb,
        (one.features.keypoints[pairs.first], features.keypoints[pairs.second]),
        pairs.agreed,
        f"{one.label} = {_short(match.object_iri)} {match.confidence:.2f}, {verdict}, "
        f"{int(pairs.agreed.sum())} of {len(pairs.first)} matches agree",
    )


def _stack(pictures: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    import numpy as np

    width = max(picture.shape[1] for picture in pictures)
    rows = [np.pad(p, ((0, 6), (0, width - p.shape[1]), (0, 0))) for p in pictures]
    return np.concatenate(rows)
