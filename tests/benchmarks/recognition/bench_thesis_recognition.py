"""Recognition of turned YCB objects, as in Kehoe 2014, 4.5 and 4.6, beside the thesis's figures.

    python bench_thesis_recognition.py sets --cache FOLDER  # table 4.1
    python bench_thesis_recognition.py curve --cache FOLDER --save-plot OUT.png

``sets`` stores six products from random and from evenly chosen sides, as table 4.1 does. ``curve``
draws figures 4.8 and 4.9 (recall and false answers over the share of stored views), and prints what
section 4.6 says of confidences. Both need the cache that ``bench_recognition.py turntable --cache``
fills; ``rtask thesis show kehoe-4.1`` and its like run the same on products of the simulator, and
the tables of Gatto 2016.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # what is timed is one thread of either side

import cv2
import numpy as np
from numpy.typing import NDArray

from features.recognition import Recogniser, Recognition, RecognitionIndex, warm_up
from tests.benchmarks.recognition.turntable import (
    described_views,
    without_depth,
    ycb_folder,
    ycb_names,
)

SIX = (
    *("cracker_box", "mustard_bottle", "potted_meat_can"),
    *("pudding_box", "sugar_box", "tomato_soup_can"),
)


def sets(args: argparse.Namespace) -> None:
    """Recall of six products by how their stored views were chosen, of all others asked."""
    folder = _turntable_folder(args)
    views = [(n, f) for n in SIX for f in described_views(folder, n, 5, 0, args.cache)]
    # Of each object 72 views around it at two elevations, and four from above.
    place = np.arange(len(views)) % (len(views) // len(SIX))
    rng = np.random.default_rng(args.seed)
    warm_up()
    for title, kept in (
        ("random", rng.random(len(views)) < 0.37),
        ("every 60 degrees", (place % 12 == 0) & (place < 144)),
        ("every 30 degrees", (place % 6 == 0) & (place < 144)),
        ("every 15 degrees", (place % 3 == 0) & (place < 144)),
        ("15, and from above", (place % 3 == 0) | (place == 145)),
    ):
        index = RecognitionIndex()
        start = time.perf_counter()
        for k in np.flatnonzero(kept):
            index.add(f"v:{k}", views[k][0], "class:ycb", views[k][1])
        adding = (time.perf_counter() - start) / kept.sum()
        index.save()
        recogniser, right, false, seconds = Recogniser(index), 0, 0, []
        for k in np.flatnonzero(~kept):
            start = time.perf_counter()
            answer = recogniser.recognise(views[k][1])
            seconds.append(time.perf_counter() - start)
            if answer.accepted:
                is_right = answer.matches[0].object_iri == views[k][0]
                right, false = right + is_right, false + (not is_right)
        print(
            f"{title:18s} {kept.sum():4d} of {len(views)} stored: recall {right} of {len(seconds)} "
            f"= {right / len(seconds):.3f}, false {false}; a view added in {1e3 * adding:.1f} ms, "
            f"recognised in {1e3 * np.median(seconds):.0f} ms, load {os.getloadavg()[0]:.0f}"
        )


def _turntable_folder(args: argparse.Namespace) -> Path:
    folder = ycb_folder()
    if folder is None or args.cache is None:
        raise SystemExit("skipped: needs --cache, and ycb in $RTASK_SHARED_DATA")
    return folder


def curve(args: argparse.Namespace) -> None:
    """Recall and false answers by the share of stored views; confidences at one fifth."""
    folder = _turntable_folder(args)
    names = ycb_names(folder)[:: args.every]
    views = [(n, f) for n in names for f in described_views(folder, n, 5, 0, args.cache)]
    lines: dict[str, list[tuple[float, float, float]]] = {"with depth": [], "colour only": []}
    for share in (0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5):
        for title, seen in (("with depth", lambda f: f), ("colour only", without_depth)):
            rng = np.random.default_rng([args.seed, int(1000 * share)])
            kept = rng.random(len(views)) < share
            index = RecognitionIndex()
            for k in np.flatnonzero(kept):
                index.add(f"v:{k}", views[k][0], "class:ycb", seen(views[k][1]))
            index.save()
            recogniser = Recogniser(index)
            answers = [
                (views[k][0], recogniser.recognise(seen(views[k][1])))
                for k in rng.permutation(np.flatnonzero(~kept))[: args.queries]
            ]
            accepted = [(n, a) for n, a in answers if a.accepted]
            right = sum(a.matches[0].object_iri == n for n, a in accepted)
            recall, false = right / len(answers), (len(accepted) - right) / len(answers)
            lines[title].append((share, recall, false))
            print(f"{title:12s} {share:5.1%} stored: recall {recall:.3f}, false {false:.4f}")
            if share == 0.2 and title == "with depth":
                _report_confidences(answers)
    if args.save_plot:
        _plot(lines, args.save_plot)


def _report_confidences(answers: list[tuple[str, Recognition]]) -> None:
    """Compare right and wrong first matches, accepted or not (Kehoe 2014, 4.6)."""
    for title, is_right in (("right", True), ("false", False)):
        first, second = [], []
        for name, answer in answers:
            if answer.matches and (answer.matches[0].object_iri == name) == is_right:
                first.append(answer.matches[0].confidence)
                if len(answer.matches) > 1:
                    second.append(answer.matches[1].confidence / answer.matches[0].confidence)
        if first:
            print(
                f"    first match {title}: {len(first)} times, mean confidence "
                f"{np.mean(first):.2f}, second over first {np.mean(second or [0]):.2f} "
                f"({'thesis .49 and .30' if is_right else 'thesis .06 and .79'})"
            )


def _plot(lines: dict[str, list[tuple[float, float, float]]], path: Path) -> None:
    """Draw both figures: recall above, false answers below, the thesis's numbers as crosses."""
    width, height, left, right = 720, 300, 70, 700
    sheet = np.full((2 * height, width, 3), 255, np.uint8)
    colours = {"with depth": (160, 90, 0), "colour only": (0, 110, 220)}
    panels = (
        (1, 1.0, "recall", ((0.35, 0.90), (0.37, 0.79))),
        (2, 0.01, "wrong answers", ()),
    )
    for row, (column, most, label, thesis) in enumerate(panels):
        base, top = (row + 1) * height - 40, row * height + 25

        def at(x: float, y: float, base=base, top=top, most=most) -> tuple[int, int]:
            return (
                round(left + (right - left) * x / 0.5),
                round(base - (base - top) * min(y / most, 1)),
            )

        for tick in range(6):
            x, y = at(tick / 10, most * tick / 5)
            cv2.line(sheet, (left, y), (right, y), (225, 225, 225), 1)
            cv2.line(sheet, (x, top), (x, base), (225, 225, 225), 1)
            _text(sheet, f"{100 * most * tick / 5:.3g} %", (16, y + 4))
            _text(sheet, f"{10 * tick} %", (x - 12, base + 16))
        cv2.rectangle(sheet, (left, top), (right, base), (120, 120, 120), 1)
        _text(sheet, f"{label} over the share of stored views", (left, top - 8))
        for k, (title, points) in enumerate(lines.items()):
            drawn = [at(point[0], point[column]) for point in points]
            cv2.polylines(sheet, [np.array(drawn)], False, colours[title], 2, cv2.LINE_AA)
            for place in drawn:
                cv2.circle(sheet, place, 4, colours[title], -1, cv2.LINE_AA)
            _text(sheet, title, (right - 150, (top + base) // 2 + 18 * k), colours[title])
        for x, y in thesis:
            cv2.drawMarker(sheet, at(x, y), (90, 90, 90), cv2.MARKER_CROSS, 13, 2)
        note = "Kehoe 2014" if thesis else "Kehoe 2014: below 1 %"
        _text(sheet, note, (right - 150, (top + base) // 2 + 36), (90, 90, 90))
    cv2.imwrite(str(path), sheet, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"drawn to {path}")


def _text(
    sheet: NDArray[np.uint8], text: str, place: tuple[int, int], colour: tuple = (40, 40, 40)
) -> None:
    cv2.putText(sheet, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1, cv2.LINE_AA)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=("sets", "curve"))
    parser.add_argument("--cache", type=Path, help="described views of the turntable")
    parser.add_argument("--every", type=int, default=1, help="curve: every so many objects")
    parser.add_argument("--queries", type=int, default=300, help="curve: views asked each time")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--save-plot", type=Path)
    args = parser.parse_args()
    (curve if args.command == "curve" else sets)(args)


if __name__ == "__main__":
    main()
