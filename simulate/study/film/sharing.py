"""A moving picture of sharing: one robot fails, finds out and writes; the next holds at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rtask.engine.words import reason_words
from rtask.errors import RobotError
from rtask.scratch import ScratchFolder
from simulate.demo.products import by_product
from simulate.demo.recorded import unpack
from simulate.demo.report_attempts import attempt_pictures, phase_of
from simulate.study.film.robots import Film, write_film

__all__ = ["Scene", "film_sharing", "scenes_of", "write_recorded"]

_PANEL = (480, 360)
_GAP, _HEAD, _FOOT = 16, 48, 116
_PLAN = (150, 84)
"""Of the drawing of the hand at the product, px."""
_PAPER, _INK, _QUIET = (250, 248, 247), (36, 36, 27), (99, 99, 86)
_GOOD, _BAD, _PRODUCT, _HAND = (67, 127, 26), (63, 18, 179), (138, 192, 231), (85, 65, 51)
_HOLDS = {"pre_grasp": 1, "closed": 2, "held": 2, "placed": 2}
"""Pictures that each phase is shown for."""

Picture = NDArray[np.uint8]


@dataclass(frozen=True)
class Scene:
    """One picture of the film.

    Parameters
    ----------
    left, right
        Pictures of the first and of the second robot; None = not yet at work.
    attempt
        The attempt that is shown, with ``hand`` and ``held``.
    is_right
        Whether it is one of the second robot.
    is_over
        Whether its outcome is known by now.
    words
        What happens, in lines.
    outcome
        How the attempt ended, in words; empty while it goes on.
    length
        How many pictures it lasts.
    """

    left: Path | None
    right: Path | None
    attempt: Mapping[str, Any]
    is_right: bool
    is_over: bool
    words: tuple[str, ...]
    outcome: str
    length: int


def write_recorded(out: Path) -> None:
    """Write the film of the recorded demo: ``.webp``, ``.png`` or ``.gif``."""
    with ScratchFolder("film") as place:
        folder = place / "demo"
        result = unpack(folder)
        frames = film_sharing(folder / "report", result)
    write_film(out, [frames], Film(frames_per_s=1.0, speed=1.0))


def film_sharing(folder: Path, result: Mapping[str, Any]) -> list[Picture]:
    """Return the pictures (h, w, 3) RGB of the film of a demo.

    Parameters
    ----------
    folder
        Of its report, with a folder of pictures for each robot.
    result
        What ``rtask demo --json`` prints.

    Raises
    ------
    RobotError
        In this run no product shows what sharing is worth.
    """
    met, learned = _product_that_shows_it(result)
    names = str(met["robot"]), str(learned["robot"])
    frames = []
    for scene in scenes_of(folder, met, learned, _sentence(result, names[1])):
        frames += [_compose(scene, names, met.get("hidden") or {})] * scene.length
    return frames


def _product_that_shows_it(
    result: Mapping[str, Any],
) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Return what two robots did with a product at which the first failed before it held.

    The second one held it at the first attempt, by a grasp from the graph.
    """
    robots = [str(robot["name"]) for robot in result["robots"]]
    work = {
        name: by_product([met for met in result["objects"] if met["robot"] == name])
        for name in robots
    }
    for number, name in enumerate(robots):
        for met in work[name]:
            if not met["product"] or (met["tries_to_success"] or 0) < 2:
                continue
            for other in robots[number + 1 :]:
                for again in work[other]:
                    first = again["attempts"][0] if again["attempts"] else {}
                    is_remembered = first.get("source") == "memory" and again["placed"]
                    if again["product"] == met["product"] and is_remembered and first["held"]:
                        return met, again
    raise RobotError("in this demo no robot failed at a product that the next one held at once")


def _sentence(result: Mapping[str, Any], robot: str) -> str:
    gains = [gain["sentence"] for gain in result["gains"] if gain["robot"] == robot]
    return str(gains[0]) if gains else ""


def scenes_of(
    folder: Path, met: Mapping[str, Any], learned: Mapping[str, Any], sentence: str
) -> Iterator[Scene]:
    """Yield the scenes: the first robot's attempts, what it writes, and the second's attempt."""
    first, second, product = met["robot"], learned["robot"], met["product"]
    tried = [attempt for attempt in met["attempts"] if attempt.get("run")]
    tried = tried[: int(met["tries_to_success"])]
    left: Path | None = None
    for number, attempt in enumerate(tried, start=1):
        start = f"{first} has never seen {product}. Attempt {number}"
        for phase, left in _pictures(folder, first, attempt):
            is_over = phase != "pre_grasp"
            outcome = _outcome(attempt) if is_over else ""
            yield Scene(left, None, attempt, False, is_over, (start,), outcome, _HOLDS[phase])
    written = f"{first} writes into the graph what failed and what held."
    yield Scene(left, None, tried[-1], False, True, (written,), "", 3)
    attempt = learned["attempts"][0]
    right: Path | None = None
    for phase, right in _pictures(folder, second, attempt):
        is_over = phase in ("held", "placed")
        words = (f"{second} has never touched {product}. It asks the graph. Attempt 1",)
        outcome = _outcome(attempt) if is_over else ""
        yield Scene(left, right, attempt, True, is_over, words, outcome, _HOLDS[phase])
    yield Scene(left, right, attempt, True, True, _wrapped(sentence), "", 6)


def _outcome(attempt: Mapping[str, Any]) -> str:
    return "Held." if attempt["held"] else f"Failed: {reason_words(attempt['reason'])}."


def _pictures(folder: Path, robot: str, attempt: Mapping[str, Any]) -> Iterator[tuple[str, Path]]:
    for path in attempt_pictures(folder, robot, attempt):
        yield phase_of(path), path


def _wrapped(sentence: str, most: int = 74) -> tuple[str, ...]:
    """Return a sentence in lines."""
    lines = [""]
    for word in sentence.split():
        if len(lines[-1]) + len(word) >= most:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return tuple(lines)


def _compose(scene: Scene, names: Sequence[str], hidden: Mapping[str, Any]) -> Picture:
    """Return the picture of a scene: both robots, the hand at the product, and what happens."""
    width, height = 2 * _PANEL[0] + 3 * _GAP, _HEAD + _PANEL[1] + _FOOT
    canvas = np.full((height, width, 3), _PAPER, np.uint8)
    for number, path in enumerate((scene.left, scene.right)):
        x = _GAP + number * (_PANEL[0] + _GAP)
        _write(canvas, names[number], (x, _HEAD - 14), 22, _INK if path else _QUIET, 700)
        panel = canvas[_HEAD : _HEAD + _PANEL[1], x : x + _PANEL[0]]
        if path is None:
            panel[:] = (240, 238, 236)
            continue
        picture = cv2.imread(str(path))
        if picture is None:
            raise RobotError(f"{path} is no picture")
        panel[:] = cv2.resize(picture, _PANEL, interpolation=cv2.INTER_AREA)
        if scene.is_over and scene.is_right == bool(number):
            colour = _GOOD if scene.attempt["held"] else _BAD
            cv2.rectangle(panel, (0, 0), (_PANEL[0] - 1, _PANEL[1] - 1), colour, 6)
    top = _HEAD + _PANEL[1] + 14
    if scene.attempt.get("hand") and hidden:
        _draw_plan(canvas[top : top + _PLAN[1], _GAP : _GAP + _PLAN[0]], scene, hidden)
    for number, line in enumerate((*scene.words, scene.outcome)):
        colour = _colour(scene) if number == len(scene.words) else _INK
        _write(canvas, line, (2 * _GAP + _PLAN[0], top + 26 + 30 * number), 20, colour, 600)
    return np.ascontiguousarray(canvas[..., ::-1])


def _colour(scene: Scene) -> tuple[int, int, int]:
    return _GOOD if scene.attempt["held"] else _BAD


def _write(
    canvas: Picture, text: str, at: tuple[int, int], size: int, colour: Sequence[int], weight: int
) -> None:
    cv2.putText(canvas, text, at, colour, cv2.FontFace("sans"), size, weight)


def _draw_plan(canvas: Picture, scene: Scene, hidden: Mapping[str, Any]) -> None:
    """Draw the product from above, its hidden part hatched, and the hand, to scale."""
    hand = scene.attempt["hand"]
    scale = 0.8 * canvas.shape[1] / hidden["length_m"]
    middle = np.array(canvas.shape[1::-1]) / 2

    def corners(x: float, y: float, length: float, width: float) -> NDArray[np.int32]:
        box = np.array([[x, y], [x + length, y], [x + length, y + width], [x, y + width]])
        return np.asarray(np.round(middle + scale * box * (1, -1)), np.int32)

    half, wide = hidden["length_m"] / 2, hand["width_m"]
    cv2.fillPoly(canvas, [corners(-half, -wide / 2, 2 * half, wide)], _PRODUCT, cv2.LINE_AA)
    if hidden.get("weak_m"):
        start, end = hidden["weak_m"]
        for x in np.arange(start, end, 0.008):
            line = corners(x, -wide / 2, min(0.008, end - x), wide)[[3, 1]]
            cv2.line(canvas, line[0].tolist(), line[1].tolist(), _BAD, 2, cv2.LINE_AA)
    turn = np.array([np.cos(hand["angle"]), np.sin(hand["angle"])])
    across = np.array([-turn[1], turn[0]])
    at = np.array([hand["along_m"], hand["across_m"]])
    for side in (-1, 1):
        inner = at + side * turn * min(hand["opening_m"] / 2, 0.03)
        finger = [inner + side * turn * d + across * w for d, w in
                  ((0, -0.008), (0, 0.008), (0.009, 0.008), (0.009, -0.008))]  # fmt: skip
        points = np.asarray(np.round(middle + scale * np.array(finger) * (1, -1)), np.int32)
        cv2.fillPoly(canvas, [points], _HAND, cv2.LINE_AA)
