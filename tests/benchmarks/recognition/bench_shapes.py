"""Ask for rendered objects with depth, with and without the evidence of shape.

    python bench_shapes.py --cache FOLDER           # those that fitted nothing
    python bench_shapes.py --cache FOLDER --fitted  # the others

Stores hold eight of ten objects, or 29 of all, with 8 or 3 views each. Unknown are the other
objects, each stored one while it is taken out, and look-alikes of stored ones on the same mesh:
the print shuffled, its hue turned, tools tinted. In some of the stores half of the look-alikes are
stored as well. Each query is decided twice, by the look alone (colours, outline, size) and by
likeness in colours and shape; intervals are of 90 %, by resampling objects. ``bench_light.py`` fits
the constants. Either takes ten minutes of one core.
"""

from __future__ import annotations

import argparse
import pickle
import random
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from features.recognition import Recogniser, RecognitionIndex, ViewFeatures
from features.recognition.confidence import ConfidenceParams, Evidence, confidences, decide
from tests.benchmarks.recognition.turntable import (
    LOW,
    is_fitted,
    render_views,
    ycb_folder,
    ycb_names,
)

Views = dict[str, list[ViewFeatures]]
STEP_DEG, GROUP, KNOWN, KNOWN_OF_ALL, ASKED = 30, 10, 8, 29, 6
PRINTED = frozenset(
    [
        "baseball",
        "bleach_cleanser",
        "bowl",
        "cracker_box",
        "gelatin_box",
        "large_marker",
        "master_chef_can",
        "mini_soccer_ball",
        "mug",
        "mustard_bottle",
        "pitcher_base",
        "plate",
        "potted_meat_can",
        "pudding_box",
        "rubiks_cube",
        "softball",
        "sponge",
        "sugar_box",
        "tomato_soup_can",
        "tuna_fish_can",
        "windex_bottle",
        "wood_block",
    ]
)
TOOLS = frozenset(
    [
        "adjustable_wrench",
        "apple",
        "banana",
        "foam_brick",
        "fork",
        "hammer",
        "knife",
        "lemon",
        "padlock",
        "power_drill",
        "scissors",
        "skillet_lid",
        "spatula",
        "spoon",
    ]
)


@dataclass(frozen=True)
class Half:
    """Half of the objects, and the sides that they and their look-alikes are seen from."""

    is_fitted: bool
    name: str
    seed: int
    draws: int
    first_deg: tuple[float, float]
    elevations: tuple[float, ...]


FITTED = Half(True, "fitted", 1000, 2, (0.0, 5.0), LOW)
OTHERS = Half(False, "others", 9000, 3, (13.0, 21.0), (0.3, 0.55))


@dataclass(frozen=True, eq=False)
class Query:
    """One view that was asked, with the evidence for every candidate."""

    name: str
    truth: str | None
    store: str
    is_lookalike: bool
    candidates: tuple[tuple[str, Evidence], ...]

    @property
    def thing(self) -> str:
        """Object that the mesh is of: look-alikes are resampled together with it."""
        return self.name.split("~")[0]


def lookalikes(folder: Path, name: str, out: Path) -> Iterator[str]:
    """Write models of the same mesh and another texture; return their names."""
    kinds = ("shuffle", "hue") if name in PRINTED else ("tint",) if name in TOOLS else ()
    for kind in kinds:
        other = f"{name}~{kind}"
        mine = out / other
        if not (out / f"{other}.urdf").is_file():
            shutil.rmtree(mine, ignore_errors=True)
            mine.mkdir(parents=True)
            for file in (folder / name).iterdir():
                if file.suffix != ".stl":
                    (mine / file.name).write_bytes(file.read_bytes())
            texture = np.asarray(cv2.imread(str(mine / "texture_map.jpg")), np.uint8)
            changed = _changed(texture, kind, np.random.default_rng(crc32(other.encode())))
            cv2.imwrite(str(mine / "texture_map.jpg"), changed, [cv2.IMWRITE_JPEG_QUALITY, 92])
            urdf = (folder / f"{name}.urdf").read_text()
            urdf = urdf.replace(f"{name}/textured.obj", f"{other}/textured.obj")
            urdf = urdf.replace(f"{name}/textured_coacd", f"{folder}/{name}/textured_coacd")
            (out / f"{other}.urdf").write_text(urdf)
        yield other


def _changed(bgr: NDArray[np.uint8], kind: str, rng: np.random.Generator) -> NDArray[np.uint8]:
    if kind == "shuffle":
        count = 24
        high, wide = (side // count for side in bgr.shape[:2])
        tiles = bgr[: high * count, : wide * count].reshape(count, high, count, wide, 3)
        tiles = tiles.swapaxes(1, 2).reshape(count * count, high, wide, 3)
        covered = np.flatnonzero((tiles.max(axis=3) > 12).mean(axis=(1, 2)) > 0.98)
        order = np.arange(count * count)
        order[covered] = rng.permutation(covered)
        whole = tiles[order].reshape(count, count, high, wide, 3).swapaxes(1, 2)
        return whole.reshape(high * count, wide * count, 3)
    if kind == "hue":
        hsv = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV))
        hsv[..., 0] = (hsv[..., 0].astype(int) + int(rng.integers(40, 140))) % 180
        return np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR), np.uint8)
    return np.clip(bgr * rng.uniform(0.55, 1.1, 3), 0, 255).astype(np.uint8)


def views_of_half(half: Half, folder: Path, cache: Path) -> tuple[Views, Views]:
    """Return described views of the objects and of their look-alikes."""
    names = [name for name in ycb_names(folder) if is_fitted(name) == half.is_fitted]
    models = cache / "lookalikes"
    others = [other for name in names for other in lookalikes(folder, name, models)]

    def seen(place: Path, name: str, which: int) -> list[ViewFeatures]:
        file = cache / half.name / f"{name}.pickle"
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            first = half.first_deg[which]
            shots = render_views(place, name, STEP_DEG, half.seed + which, first, half.elevations)
            file.write_bytes(pickle.dumps([shot.describe().to_bytes() for shot in shots]))
        return [ViewFeatures.from_bytes(data) for data in pickle.loads(file.read_bytes())]

    return {n: seen(folder, n, 0) for n in names}, {n: seen(models, n, 1) for n in others}


def gather(half: Half, views: Views, others: Views) -> list[Query]:
    """Store and ask."""
    queries: list[Query] = []
    for draw in range(half.draws):
        order = random.Random(half.seed + draw).sample(sorted(views), len(views))
        groups = [order[k : k + GROUP] for k in range(0, len(order) - 4, GROUP)]
        plans = [(group, count, False) for group in groups for count in (8, 3)]
        if draw == 0:
            plans += [(group, count, True) for group in groups for count in (8, 3)]
            plans += [(order, count, False) for count in (8, 3)]
        for group, count, stores_lookalikes in plans:
            key = f"{half.seed} {draw} {group[0]} {count} {stores_lookalikes} {len(group)}"
            rng = random.Random(key)
            queries += _asked(rng, group, count, stores_lookalikes, views, others)
    return queries


def _asked(
    rng: random.Random,
    group: list[str],
    count: int,
    stores_lookalikes: bool,
    views: Views,
    others: Views,
) -> list[Query]:
    """Ask one store for its objects, others, and look-alikes of its objects."""
    is_large = len(group) > GROUP
    known = min(KNOWN_OF_ALL if is_large else KNOWN, len(group) - 2)
    stored = set(rng.sample(sorted(group), known))
    alike = [name for name in sorted(others) if name.split("~")[0] in stored]
    if stores_lookalikes:
        stored |= set(rng.sample(alike, len(alike) // 2))
    all_views = {**views, **others}
    shuffled = {n: rng.sample(all_views[n], len(all_views[n])) for n in (*group, *alike)}
    index = RecognitionIndex()

    def put(name: str) -> None:
        for k, view in enumerate(shuffled[name][:count]):
            index.add(f"{name}/{k}", name, "class:ycb", view)

    for name in sorted(stored):
        put(name)
    recogniser = Recogniser(index)
    size = "29 of all" if is_large else "8 of ten"
    store = f"{size} known, {count} views"
    asked = ASKED // 2 if is_large else ASKED

    def ask(name: str, queries: Sequence[ViewFeatures], is_stored: bool) -> list[Query]:
        truth = name if is_stored else None
        snapshot = index.snapshot()
        return [
            Query(name, truth, store, name in others and not is_stored, tuple(
                (snapshot.object_iris[one.object_number], one.evidence)
                for one in recogniser.gather(query, snapshot)
            ))
            for query in queries
        ]  # fmt: skip

    found = []
    for name in (*group, *alike):
        most = asked if name in group else max(asked // 2, 2)
        found += ask(name, shuffled[name][18 : 18 + most], name in stored)
    if not is_large and not stores_lookalikes:
        for name in sorted(stored):
            for k in range(count):
                index.remove(f"{name}/{k}")
            found += ask(name, shuffled[name][18 : 18 + asked], False)
            put(name)
    return found


def decided(query: Query, with_shape: bool) -> tuple[bool, bool]:
    """Return whether the first answer is accepted, and whether it is right."""
    if not query.candidates:
        return False, False
    evidence = [e if with_shape else replace(e, likeness=None) for _, e in query.candidates]
    constants = ConfidenceParams()
    sure = confidences(evidence, constants)
    order = np.argsort(-sure, kind="stable")
    _, accepted = decide(sure[order], constants.threshold, constants)
    return accepted, query.candidates[int(order[0])][0] == query.truth


def report(queries: list[Query]) -> None:
    """Print recall and false answers without and with shape, and intervals of the difference."""
    for store in (*sorted({query.store for query in queries}), "all"):
        mine = [query for query in queries if store in (query.store, "all")]
        answers = [(decided(query, False), decided(query, True)) for query in mine]
        known = [query.truth is not None for query in mine]
        line = f"{store:26s}"
        for which, title in enumerate(("without", "with shape")):
            right = [a[which] == (True, True) for a, k in zip(answers, known, strict=True) if k]
            wrong = [a[which] == (True, False) for a, k in zip(answers, known, strict=True) if k]
            strange = [
                (query.is_lookalike, a[which][0])
                for query, a, k in zip(mine, answers, known, strict=True)
                if not k
            ]
            look = [accepted for is_alike, accepted in strange if is_alike]
            other = [accepted for is_alike, accepted in strange if not is_alike]
            line += f" {title}: recall {np.mean(right):.3f} of {len(right)}, wrong {sum(wrong)}, "
            line += f"unknown {sum(other)} of {len(other)}, look-alikes {sum(look)} of {len(look)};"
        gains = [
            (query.thing, float(after == (True, True)) - float(before == (True, True)))
            for query, (before, after) in zip(mine, answers, strict=True)
            if query.truth is not None
        ]
        print(f"{line} recall {interval(gains)}")


def interval(gains: list[tuple[str, float]]) -> str:
    """Return the mean of gains, each with the object it is of, and its interval."""
    things = sorted({thing for thing, _ in gains})
    sums = np.zeros((len(things), 2))
    for thing, gain in gains:
        sums[things.index(thing)] += gain, 1.0
    drawn = np.random.default_rng(1).integers(len(things), size=(2000, len(things)))
    again = sums[drawn].sum(axis=1)
    low, high = np.quantile(again[:, 0] / again[:, 1], [0.05, 0.95])
    return f"{sums[:, 0].sum() / sums[:, 1].sum():+.3f} ({low:+.3f} to {high:+.3f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cache", type=Path, required=True, help="folder for views and evidence")
    parser.add_argument("--fitted", action="store_true", help="the half that is fitted on")
    args = parser.parse_args()
    folder = ycb_folder()
    if folder is None:
        parser.error("needs the YCB models: set RTASK_SHARED_DATA to the folder that holds ycb")
    half = FITTED if args.fitted else OTHERS
    file = args.cache / f"{half.name}.pickle"
    if not file.is_file():
        views, others = views_of_half(half, folder, args.cache)
        file.write_bytes(pickle.dumps(gather(half, views, others)))
    queries: list[Query] = pickle.loads(file.read_bytes())
    report(queries)


if __name__ == "__main__":
    main()
