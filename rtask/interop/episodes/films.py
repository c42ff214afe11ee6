"""Films of an attempt: pictures that move, one of each camera, as animated PNG.

An animated PNG (PNG, third edition, W3C 2025) is a picture wherever pictures are taken or shown.
The name of the picture is that of the camera.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import DataError
from rtask.interop.episodes.episode import Episode

if TYPE_CHECKING:
    import pyarrow

    from rtask.kb.core import GraphCore

__all__ = ["Film", "Shots", "decode_film", "encode_film", "films_of", "pooled",
           "shots_of"]  # fmt: skip

_PNG = b"\x89PNG\r\n\x1a\n"
_ANIMATION, _FIRST_DATA = b"acTL", b"IDAT"
_MS = 1000.0
_LEVELS = 255.0


@dataclass(frozen=True, eq=False)
class Film:
    """What one camera saw during an attempt.

    Parameters
    ----------
    frames : (n, h, w, 3) uint8 RGB
    starts : (n,) float, s
        From which time on each is shown, since the attempt began; the first is 0.
    """

    frames: NDArray[np.uint8]
    starts: NDArray[np.float64]

    def at(self, times: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return the number of the frame that is shown at each time (k,), s."""
        # Durations are whole milliseconds.
        shown = np.searchsorted(self.starts, times + 0.5 / _MS, side="right") - 1
        return np.asarray(np.maximum(shown, 0), dtype=np.intp)


def encode_film(frames: Sequence[NDArray[np.uint8]], rate_hz: float) -> bytes:
    """Return frames (h, w, 3) RGB, one a step, as animated PNG; one that repeats lasts longer."""
    import cv2

    animation = cv2.Animation()
    animation.frames = [np.ascontiguousarray(frame[..., ::-1]) for frame in frames]
    animation.durations = [round(_MS / rate_hz)] * len(frames)
    done, data = cv2.imencodeanimation(".png", animation, [])
    if not done:
        raise DataError(f"{len(frames)} frames cannot be written as animated PNG")
    return bytes(data)


def decode_film(data: bytes) -> Film | None:
    """Return the film that a picture is; None if it does not move.

    Raises
    ------
    DataError
        It is a broken film.
    """
    import cv2

    # The chunk that announces an animation, and of how many frames, comes before the first one.
    _, is_animated, after = data.split(_FIRST_DATA, 1)[0].partition(_ANIMATION)
    if not data.startswith(_PNG) or not is_animated:
        return None
    done, animation = cv2.imdecodeanimation(np.frombuffer(data, np.uint8))
    if not done or len(animation.frames) != int.from_bytes(after[:4], "big"):
        raise DataError("an animated PNG cannot be decoded")
    frames = np.stack([frame[..., 2::-1] for frame in animation.frames]).astype(np.uint8)
    durations = np.asarray(animation.durations, np.float64)
    return Film(frames, np.concatenate([[0.0], np.cumsum(durations)[:-1]]) / _MS)


def films_of(kb: GraphCore, episode: Episode) -> dict[str, Film]:
    """Return the films of an attempt by the names of their cameras."""
    films = {}
    for picture in episode.pictures:
        film = decode_film(kb.blobs.read(picture.blob)) if picture.phase else None
        if film is not None:
            films[picture.phase] = film
    return films


@dataclass(frozen=True, eq=False)
class Shots:
    """What a camera saw in each row of a data set.

    Parameters
    ----------
    film
        With the distinct frames.
    numbers : (rows,) int
        Of the frame of each row.
    """

    film: Film
    numbers: NDArray[np.intp]

    @property
    def feature(self) -> dict[str, Any]:
        """The feature as LeRobot describes it."""
        shape = list(self.film.frames.shape[1:])
        return {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}

    def column(self) -> pyarrow.Array:
        """Return the rows as LeRobot keeps pictures: PNG beside an empty path."""
        import cv2
        import pyarrow as pa

        encoded = [
            cv2.imencode(".png", np.ascontiguousarray(frame[..., ::-1]))[1].tobytes()
            for frame in self.film.frames
        ]
        kind = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
        rows = [{"bytes": encoded[number], "path": None} for number in self.numbers.tolist()]
        return pa.array(rows, kind)

    def stats(self) -> dict[str, Any]:
        """Return the statistics of each colour, of values from 0 to 1, as LeRobot shapes them."""
        return pooled([self])


def pooled(shots: Sequence[Shots]) -> dict[str, Any]:
    """Return the statistics of several episodes' shots by one camera, each row once."""
    counts = [np.bincount(s.numbers, minlength=len(s.film.frames)) for s in shots]
    rows = float(sum(count.sum() for count in counts))
    frames = [shot.film.frames / _LEVELS for shot in shots]
    means = [values.mean(axis=(1, 2)) for values in frames]
    squares = [(values**2).mean(axis=(1, 2)) for values in frames]
    mean, square = (
        sum(count @ values for count, values in zip(counts, moments, strict=True)) / rows
        for moments in (means, squares)
    )
    figures = {
        "min": np.min([values.min(axis=(0, 1, 2)) for values in frames], axis=0),
        "max": np.max([values.max(axis=(0, 1, 2)) for values in frames], axis=0),
        "mean": mean,
        "std": np.sqrt(np.maximum(square - mean**2, 0.0)),
    }
    shaped = {name: values.reshape(3, 1, 1).tolist() for name, values in figures.items()}
    return {**shaped, "count": [int(rows)]}


def shots_of(
    films: Sequence[Mapping[str, Film]], times: Sequence[NDArray[np.float64]]
) -> list[dict[str, Shots]]:
    """Return what each camera saw in the rows of each episode.

    Of the cameras that filmed every episode at one size: a column has a value in every row.

    Parameters
    ----------
    films
        Of each episode, by camera.
    times
        Of the rows of each, s.
    """
    cameras = [
        camera
        for camera in sorted(set.intersection(*(set(taken) for taken in films)))
        if len({taken[camera].frames.shape[1:] for taken in films}) == 1
    ]
    return [
        {camera: Shots(taken[camera], taken[camera].at(when)) for camera in cameras}
        for taken, when in zip(films, times, strict=True)
    ]
