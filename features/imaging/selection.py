"""The one object of a picture: by a mask or a box of another tool, by depth, by its foreground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from features.codec.limits import CloudFormatError
from features.geometry import Frame, Intrinsics
from features.imaging.foreground import find_foreground
from features.imaging.masks import box_mask, fit_labels
from features.imaging.photo import Photo
from features.segmentation.scene import segment_scene

__all__ = ["chosen_object", "frame_of_photo", "view_of_photo"]

_MAX_OBJECT_PX = 1_280
_PHOTO_FOV_RAD = 1.0


def frame_of_photo(
    photo: Photo,
    labels: NDArray[np.int32] | None = None,
    label: int | None = None,
    box: Sequence[float] | None = None,
) -> Frame:
    """Return the crop of the object in a photograph without depth; see :func:`view_of_photo`.

    Parameters
    ----------
    label
        Which of the labels; None = all together.

    Raises
    ------
    CloudFormatError
        When mask or box do not fit the photograph, or are empty.
    """
    if labels is not None:
        labels = _of_label(labels, label).astype(np.int32)
    view, labels = view_of_photo(photo, labels, box)
    return replace(view.crop(labels > 0), doubts=view.doubts)


def view_of_photo(
    photo: Photo,
    labels: NDArray[np.int32] | None = None,
    box: Sequence[float] | None = None,
) -> tuple[Frame, NDArray[np.int32]]:
    """Return a photograph as a frame without depth, and the labels (h, w) of its objects.

    Parameters
    ----------
    labels : (h, w) int32 or None
        At the full or the reduced size of the photograph; 0 = no object.
    box
        [left, top, width, height] in px of the full photograph; used without ``labels``.

    Returns
    -------
    view
        At such a resolution that the longest object takes at most 1,280 px, which is what features
        are looked for on. Its camera is a guess.
    labels : (h, w) int32
        Those given; else 1 at the pixels that are not transparent, where some are; else 1 at the
        object that the photograph is about.

    Raises
    ------
    CloudFormatError
        When mask or box do not fit the photograph.
    """
    height, width = photo.rgb.shape[:2]
    if labels is None and box is None and photo.opaque is not None:
        labels = photo.opaque.astype(np.int32)  # somebody has cut the object out already
    is_guessed = labels is None and box is None
    if labels is None:
        near = None if box is None else [photo.scale * float(side) for side in box]
        labels = find_foreground(photo.rgb, near).astype(np.int32)
    labels = fit_labels(labels, (height, width))
    scale = min(1.0, _MAX_OBJECT_PX / max(_longest_side(labels), 1))
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    rgb = photo.rgb
    if scale < 1:
        rgb = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        labels = fit_labels(labels, (size[1], size[0]))
    camera = Intrinsics.from_fov(*size, _PHOTO_FOV_RAD)
    depth = np.zeros(labels.shape, np.float32)
    doubts = (photo.doubt,) if photo.doubt else ()
    return Frame(depth, camera, rgb, is_mask_guessed=is_guessed, doubts=doubts), labels


def _longest_side(labels: NDArray[np.int32]) -> int:
    longest = 0
    for number in np.unique(labels[labels > 0]).tolist():
        _, _, across, down = cv2.boundingRect((labels == number).astype(np.uint8))
        longest = max(longest, across, down)
    return longest


def chosen_object(
    frame: Frame,
    labels: NDArray[np.int32] | None = None,
    label: int | None = None,
    box: Sequence[float] | None = None,
) -> Frame:
    """Return the crop of the object that a mask or a box points at in a frame with depth.

    Inside a box, the object is the segment on the table that lies in it for the most part; where
    there is none, what differs from the background in colour.

    Raises
    ------
    CloudFormatError
        When mask or box do not fit the frame, or are empty.
    """
    if labels is not None:
        return replace(frame, mask=None).crop(
            _of_label(fit_labels(labels, frame.depth_m.shape), label)
        )
    if box is None:
        return frame
    return replace(frame, mask=None).crop(_in_box(frame, box))


def _of_label(labels: NDArray[np.int32], label: int | None) -> NDArray[np.bool_]:
    mask = np.asarray(labels > 0 if label is None else labels == label)
    if not mask.any():
        present = np.unique(labels[labels > 0])[:20].tolist()
        raise CloudFormatError(
            "the mask is empty"
            if label is None
            else f"the mask has no label {label}; it has {present}"
        )
    return mask


def _in_box(frame: Frame, box: Sequence[float]) -> NDArray[np.bool_]:
    inside = box_mask(box, frame.depth_m.shape)
    labels = segment_scene(frame.points(), frame.rgb).labels
    most = 0
    best: NDArray[np.bool_] | None = None
    for number in np.unique(labels[inside & (labels > 0)]).tolist():
        mine = np.asarray(labels == number)
        within = int((mine & inside).sum())
        if 2 * within > mine.sum() and within > most:
            most, best = within, mine
    if best is not None:
        return best
    if frame.rgb is None:
        measured: NDArray[np.bool_] = inside & (frame.depth_m > 0)
        return measured if measured.any() else inside
    return find_foreground(frame.rgb, box)
