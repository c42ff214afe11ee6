"""Pictures that ``rtask segment`` and ``rtask recognise`` write."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rtask.cli.perception.recognition import Seen, short_name
from rtask.errors import MissingBlobError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.codec.types import Cloud
    from features.geometry import Frame, UInt8Array
    from features.recognition import Match, ViewFeatures
    from features.recognition import Recognition as Answer
    from features.segmentation import Scene
    from rtask.engine.stored import Models
    from rtask.kb.core import GraphCore

__all__ = ["recognition_picture", "segments_picture"]

_MAX_MATCHES, _MIN_ROWS_PX = 6, 360
_TABLE_M = 0.008
_TABLE, _TABLE_COLOUR = 2**30, (150, 150, 110)
_PAPER, _INK = (32, 32, 36), (235, 235, 235)
_LEGEND_PX, _LINE_PX = 250, 22
_LARGE_TEXT, _TEXT = 0.55, 0.45


def segments_picture(seen: Frame | Cloud, scene: Scene) -> UInt8Array:
    """Return an RGB picture: the table tinted, the objects numbered, a legend on the right."""
    import numpy as np

    from features.geometry import Frame
    from features.pictures import draw_labels, picture_of_cloud, shade

    labels = scene.labels.copy()
    if scene.prism is not None:
        near = np.abs(scene.prism.heights) < _TABLE_M  # False where a point is missing
        labels[near & (labels == 0)] = _TABLE
    if isinstance(seen, Frame):
        image = shade(seen.depth_m, seen.intrinsics) if seen.rgb is None else seen.rgb.copy()
    else:
        points, colours = seen.grid()
        flat = None if colours is None else colours.reshape(-1, 3)
        image, labels = picture_of_cloud(points.reshape(-1, 3), flat, labels.ravel())
    table = labels == _TABLE
    image[table] = (0.6 * image[table] + 0.4 * np.array(_TABLE_COLOUR)).astype(np.uint8)
    image[labels == 0] //= 2
    labels = np.where(table, 0, labels)
    shown = draw_labels(image, labels, dict.fromkeys(range(1, len(scene.objects) + 1), ""))
    for segment in scene.objects:
        _number(shown, labels == segment.label, segment.label)
    return np.hstack([shown, _legend(scene, shown.shape[0])])


def _number(shown: UInt8Array, mask: NDArray[Any], number: int) -> None:
    """Write a number on a disc at the segment's innermost pixel, where it hides no outline."""
    import cv2
    import numpy as np

    from features.pictures import colour_of

    if not mask.any():
        return
    padded = np.pad(mask.astype(np.uint8), 1)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1]
    y, x = (int(k) for k in np.unravel_index(int(depth.argmax()), depth.shape))
    text = str(number)
    (wide, high), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, _LARGE_TEXT, 2)
    cv2.circle(shown, (x, y), max(wide, high) // 2 + 6, _PAPER, -1, cv2.LINE_AA)
    cv2.circle(shown, (x, y), max(wide, high) // 2 + 6, colour_of(number), 1, cv2.LINE_AA)
    place = (x - wide // 2, y + high // 2)
    cv2.putText(
        shown, text, place, cv2.FONT_HERSHEY_SIMPLEX, _LARGE_TEXT, _INK, 2, cv2.LINE_AA
    )  # fmt: skip


def _legend(scene: Scene, height: int) -> UInt8Array:
    """Return a column (height, _LEGEND_PX, 3) that explains the colours."""
    import cv2
    import numpy as np

    from features.pictures import colour_of

    count = len(scene.objects)
    head = f"{scene.status}: {count} object{'' if count == 1 else 's'}"
    rows: list[tuple[tuple[int, int, int] | None, str]] = [(None, head)]
    if scene.prism is not None:
        rows.append((_TABLE_COLOUR, "table"))
    for segment in scene.objects:
        cm = 100 * float(np.linalg.norm(segment.box[1] - segment.box[0]))
        cut = ", cut off" if segment.touches_border else ""
        rows.append(
            (
                colour_of(segment.label),
                f"{segment.label}: {cm:.0f} cm, {len(segment.indices)} points{cut}",
            )
        )
    room = max(height // _LINE_PX - 1, 1)
    if len(rows) > room:
        rows = [*rows[: room - 1], (None, f"and {len(rows) - room + 1} more")]
    paper = np.full((height, _LEGEND_PX, 3), _PAPER, np.uint8)
    for k, (colour, text) in enumerate(rows):
        y = (k + 1) * _LINE_PX
        if colour is not None:
            cv2.rectangle(paper, (10, y - 11), (24, y + 1), colour, -1)
        cv2.putText(
            paper, text, (10 if colour is None else 32, y),
            cv2.FONT_HERSHEY_SIMPLEX, _TEXT, _INK, 1, cv2.LINE_AA,
        )  # fmt: skip
    return np.asarray(paper)


def recognition_picture(models: Models, frame: Frame, seen: list[Seen]) -> NDArray[np.uint8]:
    """Return names and poses over the view, and under it the matches of what was recognised."""
    import numpy as np

    from features.pictures import draw_labels

    labels = np.zeros(frame.depth_m.shape, np.int32)
    for view in seen:
        top, left = view.crop.y0 - frame.y0, view.crop.x0 - frame.x0
        height, width = view.crop.depth_m.shape
        labels[top : top + height, left : left + width][view.crop.object_mask()] = view.label
    times = max(1, _MIN_ROWS_PX // len(labels))
    frame, labels = _magnified(frame, times), np.kron(labels, np.ones((times, times), np.int32))
    assert frame.rgb is not None
    overlay = draw_labels(frame.rgb, labels, {view.label: view.name for view in seen})
    pictures = []
    for view in seen:
        for rank, match in enumerate(view.answer.matches[: _shown(view.answer)]):
            stored = _stored_view(models.kb, match.view_iri)
            if rank == 0 and view.answer.accepted:
                overlay = _with_pose(overlay, frame, models, view, stored)
            if stored is not None:
                pictures.append(_matches(view, match, *stored))
    return _stack([overlay, *pictures[:_MAX_MATCHES]])


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
    view: Seen,
    stored: tuple[Frame, ViewFeatures] | None,
) -> NDArray[np.uint8]:
    """Draw the posed model; without one the box of the stored view's points, carried over."""
    import numpy as np

    from features.geometry import pose_matrix
    from features.pictures import draw_box, draw_model
    from rtask.rdf.terms import iri

    match = view.answer.matches[0]
    model = models.of(iri(match.object_iri))
    origin = (frame.x0, frame.y0)
    if view.pose is not None and model is not None:
        pose, cloud = view.pose.camera_from_object, model[1].cloud
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
    box = pose_matrix(axes.T, middle + (low + high) / 2 @ axes)
    return draw_box(
        overlay,
        frame.intrinsics,
        match.query_from_view @ box,
        (high - low) / 2,
        origin,
    )


def _matches(view: Seen, match: Match, stored: Frame, features: ViewFeatures) -> NDArray[np.uint8]:
    from features.pictures import draw_matches
    from features.recognition.pairs import counted_matches, match_views

    assert view.crop.rgb is not None
    assert stored.rgb is not None
    pairs = (counted_matches if features.picture else match_views)(view.features, features)
    verdict = "accepted" if view.answer.accepted else "not accepted"
    differs, difference = None, match.difference
    if difference is not None and view.answer.family == match.object_iri:
        verdict = f"looks like it, but differs {difference.place}"
        left, top, width, height = view.features.mask_px.tolist()
        x, y, wide, high = difference.box
        differs = (left + x * width, top + y * height, wide * width, high * height)
    return draw_matches(
        view.crop.rgb,
        stored.rgb,
        (view.features.keypoints[pairs.first], features.keypoints[pairs.second]),
        pairs.agreed,
        f"{view.label} = {short_name(match.object_iri)} {match.confidence:.2f}, {verdict}, "
        f"{int(pairs.agreed.sum())} of {len(pairs.first)} matches agree",
        differs,
    )


def _stack(pictures: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    import numpy as np

    width = max(picture.shape[1] for picture in pictures)
    rows = [np.pad(p, ((0, 6), (0, width - p.shape[1]), (0, 0))) for p in pictures]
    return np.concatenate(rows)
