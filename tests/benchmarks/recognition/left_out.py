"""Decisions by two sets of constants of print, on material that neither was fitted on.

Renders of the half of the YCB objects that is never fitted, from directions between the usual
ones, in two draws, with depth and without, there with their mirror images among the unknown; and
cartons that are painted from other seeds, mirrored too. Each object is asked once more while it is
taken out. Both sets decide the same evidence.
"""

from __future__ import annotations

import pickle
import random
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from features.recognition import ViewFeatures, describe_view
from tests.benchmarks.recognition.bench_shapes import interval
from tests.benchmarks.recognition.print_queries import (
    GROUP,
    STEP_DEG,
    Query,
    asked_of,
    gather_cartons,
    kept,
)
from tests.benchmarks.recognition.turntable import (
    is_fitted,
    render_views,
    without_depth,
    ycb_names,
)

__all__ = ["Decision", "compare", "left_out"]

FIRST_DEG, SEED, DRAWS = 11.0, 9100, (600, 601)
COUNTS, KNOWN, ASKED = (8, 3, 1), 8, 6
CARTONS = (1300, 1600)
Decision = Callable[[Query], tuple[float, bool, bool]]
"""Gives the confidence of the first answer, whether it is right, and whether accepted."""


class Answers(NamedTuple):
    """Decisions by one set: of each known query whether it is answered rightly, and false ones."""

    right: list[bool]
    wrong: int
    unknown: int
    mirrored: int

    @property
    def false(self) -> int:
        return self.wrong + self.unknown + self.mirrored


def left_out(folder: Path, families: int, cache: Path | None) -> dict[str, list[Query]]:
    """Return the queries of every material, from the cache where they were gathered before."""

    def cartons() -> list[Query]:
        return [query for seed in CARTONS for query in gather_cartons(families, seed, mirrors=True)]

    return {
        "renders with depth": kept(cache, "other-depth", lambda: _renders(folder, cache, True)),
        "renders without depth": kept(cache, "other-flat", lambda: _renders(folder, cache, False)),
        "cartons": kept(cache, "other-cartons", cartons),
    }


def _renders(folder: Path, cache: Path | None, with_depth: bool) -> list[Query]:
    names = [name for name in ycb_names(folder) if not is_fitted(name)]
    queries: list[Query] = []
    for draw in DRAWS:
        order = random.Random(draw).sample(names, len(names))
        for first in range(0, len(order), GROUP):
            rng = random.Random(f"{draw} {first}")
            stored, asked, mirrored = {}, {}, {}
            for name in order[first : first + GROUP]:
                views, turned = _described(folder, name, cache)
                if not with_depth:
                    views = [without_depth(view) for view in views]
                chosen = rng.sample(range(len(views)), max(COUNTS) + ASKED)
                stored[name] = [views[k] for k in chosen[ASKED:]]
                asked[name] = [views[k] for k in chosen[:ASKED]]
                mirrored[name] = [turned[k] for k in chosen[:ASKED]]
            kinds = {"render": asked} if with_depth else {"render": asked, "mirrored": mirrored}
            for count in COUNTS:
                few = {name: views[:count] for name, views in stored.items()}
                queries += asked_of(few, kinds, KNOWN, count, draw, takes_out=True)
    return queries


def _described(
    folder: Path, name: str, cache: Path | None
) -> tuple[list[ViewFeatures], list[ViewFeatures]]:
    """Return the views of one object, and their mirror images without depth."""
    file = None if cache is None else cache / f"other-{name}.pickle"
    if file is not None and file.is_file():
        stored: tuple[list[bytes], list[bytes]] = pickle.loads(file.read_bytes())
    else:
        shots = list(render_views(folder, name, STEP_DEG, SEED, FIRST_DEG))
        mirrored = [
            describe_view(
                np.ascontiguousarray(shot.rgb()[:, ::-1]), np.ascontiguousarray(shot.mask[:, ::-1])
            )
            for shot in shots
        ]
        stored = [s.describe().to_bytes() for s in shots], [view.to_bytes() for view in mirrored]
        if file is not None:
            file.write_bytes(pickle.dumps(stored))
    again = ViewFeatures.from_bytes
    return [again(data) for data in stored[0]], [again(data) for data in stored[1]]


def compare(title: str, queries: list[Query], before: Decision, after: Decision) -> None:
    """Print recall and false answers by both sets for every sort of store, and false ones in all.

    Intervals of 90 %, by resampling objects; of cartons, families.
    """
    print(title)
    sorts = [query.store.partition(", ")[2] for query in queries]
    total = np.zeros((2, 3), int)
    for sort in sorted(set(sorts)):
        mine = [query for query, its in zip(queries, sorts, strict=True) if its == sort]
        old, new = _answers(mine, before), _answers(mine, after)
        things = [query.name.split(",")[0] for query in mine if query.truth is not None]
        gains = [
            (thing, float(b) - float(a))
            for thing, a, b in zip(things, old.right, new.right, strict=True)
        ]
        total += [one[1:] for one in (old, new)]
        print(
            f"  {sort:32s} recall {np.mean(old.right):.3f}, {np.mean(new.right):.3f} "
            f"of {len(things)}: {interval(gains)}; wrong {old.wrong}, {new.wrong}; "
            f"unknown accepted {old.unknown}, {new.unknown} and mirrored {old.mirrored}, "
            f"{new.mirrored} of {len(mine) - len(things)}"
        )
    print(f"  false in all: {total[0].sum()}, {total[1].sum()}")


def _answers(queries: list[Query], decide: Decision) -> Answers:
    right: list[bool] = []
    wrong = unknown = mirrored = 0
    for query in queries:
        _, is_right, accepted = decide(query)
        if query.truth is not None:
            right.append(is_right and accepted)
            wrong += accepted and not is_right
        elif query.kind == "mirrored":
            mirrored += accepted
        else:
            unknown += accepted
    return Answers(right, wrong, unknown, mirrored)
