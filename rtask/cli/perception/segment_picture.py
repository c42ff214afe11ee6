"""The picture of ``rtask segment``: the table tinted, objects numbered, a legend beside them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from features.codec.types import Cloud
    from features.geometry import Frame, UInt8Array
    from features.segmentation import Scene

__all__ = ["picture"]

_TABLE_M = 0.008
_TABLE, _TABLE_COLOUR = 2**30, (150, 150, 110)
_PAPER, _INK = (32, 32, 36), (235, 235, 235)
_LEGEND_PX, _LINE_PX = 250, 22
_LARGE_TEXT, _TEXT = 0.55, 0.45


def picture(seen: Frame | Cloud, scene: Scene) -> UInt8Array:
    """Return an RGB picture of what was cut out, with a legend to its right."""
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
        image, labels = picture_of_cloud(seen.positions, seen.colours, labels)
    table = labels == _TABLE
    image[table] = (0.6 * image[table] + 0.4 * np.array(_TABLE_COLOUR)).astype(np.uint8)
    image[labels == 0] //= 2
    labels = np.where(table, 0, labels)
    shown = draw_labels(image, labels, dict.fromkeys(range(1, len(scene.objects) + 1), ""))
    for thing in scene.objects:
        _number(shown, labels == thing.label, thing.label)
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
    """Return a column (height, _LEGEND_PX, 3) that says what the colours mean."""
    import cv2
    import numpy as np

    from features.pictures import colour_of

    count = len(scene.objects)
    head = f"{scene.status}: {count} object{'' if count == 1 else 's'}"
    rows: list[tuple[tuple[int, int, int] | None, str]] = [(None, head)]
    if scene.prism is not None:
        rows.append((_TABLE_COLOUR, "table"))
    for thing in scene.objects:
        cm = 100 * float(np.linalg.norm(thing.box[1] - thing.box[0]))
        cut = ", cut off" if thing.touches_border else ""
        rows.append(
            (
                colour_of(thing.label),
                f"{thing.label}: {cm:.0f} cm, {len(thing.indices)} points{cut}",
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
