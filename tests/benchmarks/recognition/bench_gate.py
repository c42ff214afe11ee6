"""Decisions of print before and after it was opened: covers, boxes in other poses, cartons.

    python bench_gate.py --seed 11                   # generated covers and boxes
    python bench_gate.py --seed 11 --photos FOLDER   # photographs of cartons as well
    python bench_gate.py --seed 11 --renders         # renders without depth as well
    python bench_gate.py --seed 11 --only --others   # covers of another generator

Covers are stored by one scan each and asked by photographs of 40 phones, half of them under the
cover's mask, half with the desk around it. Boxes are stored and asked in poses that show their
front; of ``siblings`` two carry one brand. Photographs are asked as in ``fit_print.py``, from draws
by the seed. Each query is decided three times on the same evidence: as before, where other colours
than the stored ones and a part of the print never decided; without the extent of a print on its own
view; and as shipped. Intervals of 90 %, by resampling things.
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from features.recognition import describe_view
from features.recognition.comparison.confidence import (
    PrintParams,
    has_same_colours,
    print_score,
)
from features.recognition.confidence import ConfidenceParams, confidences, decide
from features.recognition.metrics import (
    calibration_error_by_chance,
    expected_calibration_error,
)
from tests.benchmarks.recognition.generated_packages import (
    Phone,
    artwork,
    box_faces,
    photograph_box,
    photograph_cover,
    scan,
)
from tests.benchmarks.recognition.print_queries import (
    Photographs,
    Query,
    Views,
    asked_of,
    folder_for_code,
    gather_renders,
    kept,
)
from tests.benchmarks.recognition.turntable import is_fitted, without_depth, ycb_folder
from tests.benchmarks.retrieval.other_covers import other_artwork, photograph_other_cover

PHONES = 40
BEFORE = replace(PrintParams(), wide_matches=10**6, part_extent=PrintParams().min_extent)
Decided = tuple[float, bool, bool]


def other_covers(count: int, seed: int, shots: int) -> list[Query]:
    """Ask for covers of the second generator, of which five of eight are stored."""
    queries: list[Query] = []
    for kind in ("other cover", "other cover on a desk"):
        rng = np.random.default_rng([8, seed, len(kind)])
        stored: Views = {}
        asked: Views = {}
        for k in range(count):
            name, print_ = f"{kind} {k}", other_artwork(int(rng.integers(2**31)))
            flat = scan(print_)
            stored[name] = [describe_view(flat, np.ones(flat.shape[:2], bool))]
            taken = [photograph_other_cover(print_, rng) for _ in range(shots)]
            asked[name] = [
                describe_view(image, mask if kind == "other cover" else np.ones_like(mask))
                for image, mask in taken
            ]
        queries += asked_of(stored, {kind: asked}, 5 * count // 8, 1, seed)
    return queries


def covers(count: int, seed: int, shots: int) -> list[Query]:
    """Ask for photographs of covers of which five of eight are stored."""
    queries: list[Query] = []
    for kind in ("cover", "cover on a desk"):
        rng = np.random.default_rng([5, seed, len(kind)])
        stored: Views = {}
        asked: Views = {}
        for k in range(count):
            name, print_ = f"{kind} {k}", artwork(1000 * seed + count * (kind != "cover") + k)
            flat = scan(print_)
            stored[name] = [describe_view(flat, np.ones(flat.shape[:2], bool))]
            taken = [photograph_cover(print_, _phone(seed, rng), rng) for _ in range(shots)]
            asked[name] = [
                describe_view(image, mask if kind == "cover" else np.ones_like(mask))
                for image, mask in taken
            ]
        queries += asked_of(stored, {kind: asked}, 5 * count // 8, 1, seed)
    return queries


def boxes(count: int, seed: int, shots: int, siblings: bool) -> list[Query]:
    """Ask for boxes in other poses of which two thirds are stored."""
    rng = np.random.default_rng([6, seed, siblings])
    stored: Views = {}
    asked: Views = {}
    for k in range(count):
        brand = 100 * seed + k // 2 if siblings else -1
        size, faces = box_faces(1000 * seed + 500 * siblings + k, brand)
        name, phone = f"box {k // 2 if siblings else k}, {k}", _phone(seed, rng)
        views = [photograph_box(size, faces, phone, rng) for _ in range(5)]
        stored[name] = [describe_view(*view) for view in views]
        taken = [photograph_box(size, faces, _phone(seed, rng), rng) for _ in range(shots)]
        asked[name] = [describe_view(*view) for view in taken]
    kind = "box of a brand" if siblings else "box"
    known = 2 * count // 3
    return [
        query
        for views in (1, 3, 5)
        for query in asked_of(stored, {kind: asked}, known, views, seed, seals=True)
    ]


def photographs(folder: Path, seed: int, shots: int) -> list[Query]:
    """Ask for photographs of cartons, and mirrored ones, of which ten are stored."""
    taken, rng = Photographs(folder), random.Random(f"stored {seed}")
    stored = taken.some("stored", 12, rng)
    queries: list[Query] = []
    for number, (known, views) in enumerate(((10, 5), (10, 5), (10, 3), (10, 1))):
        draw = random.Random(f"asked {seed} {number}")
        asked = {
            "photograph": taken.some("asked", shots, draw),
            "mirrored": taken.some("asked", 1, draw, mirrored=True),
        }
        queries += asked_of(stored, asked, known, views, 100 * seed + number, seals=True)
    return queries


def _phone(seed: int, rng: np.random.Generator) -> Phone:
    return Phone.of(PHONES * seed + int(rng.integers(PHONES)))


def decided(
    query: Query, params: PrintParams | None, is_before: bool = False, is_framed: bool = True
) -> Decided:
    """Return the confidence of the first answer, whether it is right, and whether accepted.

    Without constants print is not compared; unframed, its extent is that in the query alone.
    """
    constants, evidence = ConfidenceParams(), []
    for _, one, printed in query.candidates:
        if params is None:
            one = replace(one, has_print=False, is_plain=False, print_odds=None)
        elif printed is not None:
            has_colours = one.has_print_colours and not is_before
            if not is_framed:
                printed = replace(printed, framed_extent=0.0)
                has_colours = has_colours and has_same_colours(printed, params)
            odds = print_score(printed, params)
            one = replace(one, print_odds=odds, has_print_colours=has_colours)
        evidence.append(one)
    if not evidence:
        return 0.0, False, False
    sure = confidences(evidence, constants)
    order = np.argsort(-sure, kind="stable")
    _, accepted = decide(sure[order], constants.threshold, constants)
    is_right = query.candidates[int(order[0])][0] == query.truth
    return float(sure[order[0]]), is_right, accepted


def report(queries: Sequence[Query], decisions: dict[str, Callable[[Query], Decided]]) -> None:
    """Print recall and false answers by each way to decide, for every sort of store."""
    for store in sorted({query.store for query in queries}):
        mine = [query for query in queries if query.store == store]
        found: dict[str, list[tuple[str, float]]] = {}
        print(store)
        for title, decide_one in decisions.items():
            answers = [(query, *decide_one(query)) for query in mine]
            known = [(q, right, accepted) for q, _, right, accepted in answers if q.truth]
            strange = [accepted for q, _, _, accepted in answers if q.truth is None]
            found[title] = [
                (q.name.split(",")[0], float(right and accepted)) for q, right, accepted in known
            ]
            line = f"  {title:14s}"
            if known:
                first = np.mean([right for _, right, _ in known])
                wrong = sum(accepted and not right for _, right, accepted in known)
                line += f" recall {_share(found[title])} of {len(known)}, right first {first:.2f}"
                line += f", wrong {wrong}"
            sure, right = (np.array([answer[k] for answer in answers]) for k in (1, 2))
            error = expected_calibration_error(sure, right)
            line += f", unknown accepted {sum(strange)} of {len(strange)}"
            least = calibration_error_by_chance(sure)
            print(f"{line}, calibration error {error:.3f}, by chance alone {least:.3f}")
        if found["before"]:
            pairs = zip(found["before"], found["now"], strict=True)
            print(f"  difference     {_share([(a[0], b[1] - a[1]) for a, b in pairs])}")


def _share(rows: list[tuple[str, float]]) -> str:
    """Return the mean and its interval of 90 %, by resampling things."""
    things = sorted({name for name, _ in rows})
    sums = np.array([sum(v for name, v in rows if name == thing) for thing in things])
    counts = np.array([sum(name == thing for name, _ in rows) for thing in things])
    rng = np.random.default_rng(0)
    drawn: NDArray[np.intp] = rng.integers(len(things), size=(2000, len(things)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means, [0.05, 0.95])
    return f"{sums.sum() / counts.sum():.3f} ({low:.3f} to {high:.3f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=11, help="of artwork, phones and draws")
    parser.add_argument("--covers", type=int, default=32)
    parser.add_argument("--boxes", type=int, default=18)
    parser.add_argument("--shots", type=int, default=2, help="asked of each")
    parser.add_argument("--photos", type=Path, help="photographs, as for fit_print.py")
    parser.add_argument("--renders", action="store_true", help="fresh YCB objects without depth")
    parser.add_argument("--others", action="store_true", help="covers of another generator")
    parser.add_argument("--only", action="store_true", help="no generated covers and boxes")
    parser.add_argument("--cache", type=Path, help="folder for the evidence")
    args = parser.parse_args()
    cache = None if args.cache is None else folder_for_code(args.cache)
    seed, shots = args.seed, args.shots
    parts: dict[str, Callable[[], list[Query]]] = {}
    if not args.only:
        parts["covers"] = lambda: covers(args.covers, seed, shots)
        parts["boxes"] = lambda: boxes(args.boxes, seed, shots, False)
        parts["siblings"] = lambda: boxes(args.boxes, seed, shots, True)
    if args.others:
        parts["others"] = lambda: other_covers(args.covers, seed, shots)
    if args.photos is not None:
        parts["photographs"] = lambda: photographs(args.photos, seed, shots)
    ways: dict[str, Callable[[Query], Decided]] = {
        "before": lambda query: decided(query, BEFORE, True, is_framed=False),
        "unframed": lambda query: decided(query, PrintParams(), is_framed=False),
        "now": lambda query: decided(query, PrintParams()),
    }
    for part, gather in parts.items():
        report(kept(cache, f"gate-{part}-{seed}-{shots}", gather), ways)
    folder = ycb_folder()
    if args.renders and folder is not None:
        ways["without print"] = lambda query: decided(query, None)
        flat = kept(
            cache, "gate-renders",
            lambda: gather_renders(
                folder, lambda name: not is_fitted(name), args.cache, without_depth, (8, 3)
            ),
        )  # fmt: skip
        report(flat, ways)


if __name__ == "__main__":
    main()
