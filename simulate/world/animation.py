"""Animated pictures as files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rtask.errors import RobotError, UsageError

__all__ = ["check_film", "write_animation"]

_QUALITY = 80
_SUFFIXES = (".webp", ".png", ".gif")
_LAST_MS = 2000


def check_film(path: Path) -> None:
    """Refuse a file that no film can be written to.

    Raises
    ------
    UsageError
        Its suffix is another than ``.webp``, ``.png`` or ``.gif``, or its folder is missing.
    """
    if path.suffix not in _SUFFIXES:
        raise UsageError(f"{path}: expected a name ending in {', '.join(_SUFFIXES)}")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}; make it first")


def write_animation(path: Path, pictures: Sequence[NDArray[np.uint8]], pause_ms: int) -> None:
    """Write pictures (h, w, 3) RGB as one animated picture, the last of which stays for a while.

    Parameters
    ----------
    path
        ``.webp``, ``.png`` (APNG) or ``.gif``.
    pause_ms
        Between two pictures.

    Raises
    ------
    UsageError
        As :func:`check_film`.
    """
    check_film(path)
    animation = cv2.Animation()
    animation.frames = [np.ascontiguousarray(picture[..., ::-1]) for picture in pictures]
    animation.durations = [*[pause_ms] * (len(pictures) - 1), _LAST_MS]
    options = [cv2.IMWRITE_WEBP_QUALITY, _QUALITY] if path.suffix == ".webp" else []
    done, data = cv2.imencodeanimation(path.suffix, animation, options)
    if not done:
        raise RobotError(f"cannot write {path}")
    path.write_bytes(bytes(data))
