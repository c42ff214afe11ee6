"""The objects of a view: cut from the table, or given by the masks and boxes of another tool."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.perception.posed import Posed, posed_view
from rtask.cli.perception.scene_file import read_view
from rtask.cli.perception.view_options import View
from rtask.engine.perception.cutting import cut, cut_in_base
from rtask.errors import DataError, UsageError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from features.geometry import Frame
    from features.imaging.photo import Photo

__all__ = ["Selection", "objects_in", "selection_options"]


@dataclass(frozen=True)
class Selection:
    """Choice of the pixels that are objects.

    Parameters
    ----------
    mask
        PNG of labels or JSON of COCO annotations; None = find them.
    box
        Left, top, width and height around one object, px.
    """

    mask: Path | None = None
    box: tuple[float, float, float, float] | None = None


def selection_options(command: Any) -> Any:
    """Add the options of :class:`Selection` to a command."""
    for option in (
        click.option(
            "--box", nargs=4, type=float, metavar="X Y W H",
            help="Left, top, width and height of a box around the object, px.",
        ),
        click.option(
            "--mask", type=click.Path(exists=True, path_type=Path),
            help="Pixels of the objects: a PNG of labels, or JSON of COCO masks or boxes.",
        ),
    ):  # fmt: skip
        command = option(command)
    return command


def objects_in(
    file: Path, view: View, preset: str, selection: Selection
) -> tuple[Frame, list[tuple[int, Frame]]]:
    """Return the view in a file, and label and crop of each object in it.

    Parameters
    ----------
    view
        How to read the file.
    preset
        How to cut a view with depth; see ``rtask segment --segmentation``.

    Raises
    ------
    UsageError
        The file is a cloud without an image, or depth without colour.
    DataError
        The file is damaged, or the mask or the box does not fit the image.
    """
    from features.codec import CloudFormatError
    from features.geometry import Frame
    from features.imaging.camera import frame_of_grid
    from features.imaging.photo import Photo
    from features.imaging.placed import on_pixels

    seen = read_view(file, view)
    try:
        if isinstance(seen, Photo):
            return _in_photo(seen, selection)
        as_usual = preset == "auto" and selection == Selection()
        posed = posed_view(file, view, seen, is_cut_as_usual=as_usual)
        if not isinstance(seen, Frame):
            # A viewer's export has lost its rows, and still lies on the rays of its pixels.
            whole = seen if seen.is_organised else on_pixels(seen)
            grid = None if whole is None else frame_of_grid(whole)
            if grid is None:
                raise UsageError(
                    f"{file} is a cloud without an image, which recognition needs: give a "
                    "photograph, a depth image and --colour, a cloud with colours whose points lie "
                    "on the pixels of one camera, or a crop in the format that robots send"
                )
            seen = grid
        if seen.rgb is None:
            raise UsageError(
                f"{file}: recognition needs colours; give the colour image as --colour"
            )
        return seen, _in_frame(seen, preset, selection, posed)
    except CloudFormatError as error:
        raise DataError(f"{selection.mask or file}: {error}") from error


def _in_photo(photo: Photo, selection: Selection) -> tuple[Frame, list[tuple[int, Frame]]]:
    from features.imaging.selection import view_of_photo

    labels = _labels(selection, (photo.full_size[1], photo.full_size[0]))
    view, segments = view_of_photo(photo, labels, selection.box)
    return view, _crops(view, segments)


def _in_frame(
    frame: Frame, preset: str, selection: Selection, posed: Posed | None
) -> list[tuple[int, Frame]]:
    from dataclasses import replace

    from features.imaging.masks import fit_labels
    from features.imaging.selection import chosen_object

    labels = _labels(selection, frame.depth_m.shape)
    if labels is not None:
        return _crops(replace(frame, mask=None), fit_labels(labels, frame.depth_m.shape))
    if selection.box is not None:
        return [(1, chosen_object(frame, box=selection.box))]
    if frame.mask is not None:
        return [(1, frame)]
    if posed is None:
        scene = cut(frame, preset)
    else:
        scene, _ = cut_in_base(posed.view, posed.base_from_camera, body=posed.body)
    return [(segment.label, frame.crop(scene.labels == segment.label)) for segment in scene.objects]


def _crops(view: Frame, labels: NDArray[np.int32]) -> list[tuple[int, Frame]]:
    import numpy as np

    from features.codec import CloudFormatError

    numbers = np.unique(labels[labels > 0]).tolist()
    if not numbers:
        raise CloudFormatError("the mask marks no pixel of the image: 0 is no object")
    return [(number, view.crop(labels == number)) for number in numbers]


def _labels(selection: Selection, shape: tuple[int, ...]) -> NDArray[np.int32] | None:
    from features.imaging.masks import read_labels

    if selection.mask is None:
        return None
    if selection.box is not None:
        raise UsageError("--mask and --box: give one of them")
    try:
        data = selection.mask.read_bytes()
    except OSError as error:
        raise UsageError(f"{selection.mask}: {error.strerror}") from error
    return read_labels(data, (shape[0], shape[1]))
