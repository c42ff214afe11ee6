"""Recognition from several photographs of one object together.

    python tests/benchmarks/recognition/bench_looks.py --photos FOLDER

``FOLDER`` is laid out as for ``fit_print.py``. Of each draw a third of the products stays unknown,
of each other product so many photographs are stored; what is asked are disjoint groups of one, two
and three photographs of each product, answered by ``fuse``. Intervals of 90 % come from drawing
products again: photographs of one product are not independent.
"""

from __future__ import annotations

import argparse
import random
from pathlib import Path

import numpy as np

from features.recognition import Recogniser, Recognition, RecognitionIndex, fuse, warm_up
from tests.benchmarks.recognition.print_queries import Photographs, Views

_PER_CLASS = 9
_COUNTS = (1, 2, 3)


def answers_of(
    stored: Views, asked: Views, known: set[str], views: int, rng: random.Random
) -> dict[str, list[Recognition]]:
    """Store some views of the known products and ask each photograph."""
    index = RecognitionIndex()
    for name in sorted(known):
        for k, view in enumerate(rng.sample(stored[name], views)):
            index.add(f"{name}/{k}", name, "class:carton", view)
    index.save()
    recogniser = Recogniser(index)
    return {name: [recogniser.recognise(view) for view in mine] for name, mine in asked.items()}


def counted(name: str | None, answer: Recognition) -> np.ndarray:
    """Return known, right first, recognised, wrong, unknown, unknown accepted of one answer."""
    first = answer.matches[0].object_iri if answer.matches else ""
    is_known, is_right = name is not None, first == name
    return np.array(
        [
            is_known, is_known and is_right, is_known and is_right and answer.accepted,
            is_known and not is_right and answer.accepted,
            not is_known, not is_known and answer.accepted,
        ],
        float,
    )  # fmt: skip


def report(count: int, rows: dict[str, np.ndarray]) -> None:
    """Print the shares with intervals over products."""
    rng, names = np.random.default_rng(0), sorted(rows)
    again = np.array([sum(rows[n] for n in rng.choice(names, len(names))) for _ in range(500)])
    total = sum(rows.values())
    line = f"{count} looks, {total[0]:.0f} known and {total[4]:.0f} unknown asked:"
    for title, top, bottom in (
        ("right first", 1, 0), ("recall", 2, 0), ("wrong", 3, 0), ("unknown accepted", 5, 4),
    ):  # fmt: skip
        with np.errstate(invalid="ignore"):
            low, high = np.nanquantile(again[:, top] / again[:, bottom], [0.05, 0.95])
        line += f" {title} {total[top] / total[bottom]:.3f} [{low:.3f}, {high:.3f}]"
    print(line)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--views", type=int, default=5, help="stored of each product")
    parser.add_argument("--draws", type=int, default=4)
    args = parser.parse_args()
    warm_up()
    photographs = Photographs(args.photos)
    stored = photographs.some("stored", 12, random.Random(7))
    rows: dict[int, dict[str, np.ndarray]] = {count: {} for count in _COUNTS}
    for draw in range(args.draws):
        rng = random.Random(1000 + draw)
        names = sorted(stored)
        known = set(rng.sample(names, len(names) - len(names) // 3))
        asked = photographs.some("asked", _PER_CLASS, rng)
        for name, answers in answers_of(stored, asked, known, args.views, rng).items():
            truth = name if name in known else None
            for count in _COUNTS:
                for k in range(0, len(answers) - count + 1, count):
                    found = counted(truth, fuse(answers[k : k + count]))
                    rows[count][name] = rows[count].get(name, np.zeros(6)) + found
    for count in _COUNTS:
        report(count, rows[count])


if __name__ == "__main__":
    main()
