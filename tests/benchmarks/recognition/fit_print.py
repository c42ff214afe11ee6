"""Fit the constants of the confidence of print, and say what they are worth on what was left out.

    python fit_print.py --photos FOLDER --cache FOLDER             # the constants
    python fit_print.py --photos FOLDER --cache FOLDER --held-out  # brands in turn

``FOLDER`` holds ``stored/<class>/*.jpg``, ``asked/<class>/*.jpg`` and ``negatives/<kind>/*.jpg``.
Three sources are asked against stores of 2 to 10 objects with 1 to 5 views (renders: 1 to 18):
photographs under a mask of the middle 60 % of their width, mirrored ones among the unknown;
generated cartons (``generated_prints``) whose siblings differ in a known part; renders of the
fitted half of the YCB objects (``turntable.is_fitted``) without depth. Each candidate of a query is
one row, right or wrong. For each support by the object's other views (``PrintEvidence.support``)
one logistic function is fitted, with the sign of every weight held, the least weight of two of
them, and an L2 penalty (C on standardised terms). What is reported are decisions, as a recogniser
with those constants takes them; ``--held-out`` decides each photograph by a fit without its brand.
The other half of the YCB objects is never fitted; it is asked with and without depth, and each
object once more while it is taken out of the store, as one of the unknown. ``--cache`` keeps
described renders and the evidence: to gather it takes ten minutes of one core. The shipped
constants are those that it printed when print was last fitted; the evidence has changed a little.
"""

from __future__ import annotations

import argparse
import pickle
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view
from features.recognition.comparison.confidence import (
    PRINT_TERMS,
    PrintParams,
    print_score,
    print_terms,
)
from features.recognition.comparison.evidence import PrintEvidence
from features.recognition.confidence import ConfidenceParams, Evidence, confidences, decide
from features.recognition.metrics import expected_calibration_error
from tests.benchmarks.recognition.generated_prints import described, families
from tests.benchmarks.recognition.turntable import (
    described_views,
    is_fitted,
    without_depth,
    ycb_folder,
    ycb_names,
)

Views = dict[str, list[ViewFeatures]]
Weights = Sequence[Sequence[float]]
SAME_PRINT = {"Alpro-Fresh-Soy-Milk": "Alpro-Shelf-Soy-Milk"}
"""Two names of one print: no recogniser can tell them apart."""
MEANING = {"photograph": 3.0, "mirrored": 3.0, "produce": 3.0, "carton": 1.0, "render": 1.0}
"""Weight of a row by the kind of its query."""
WRONG_COUNTS = 2.0
"""A wrong candidate weighs so many times a right one."""
CAUTION = (1.0, 0.4, 0.7, 0.9)
"""Taken off the offset: a sibling that nobody stored is worse than a question."""
STEP_DEG, GROUP = 30, 10
"""Between the views of a render; and so many objects are asked together."""
MIN_EXTENT = 3.0
"""The least that the area between the matches counts: an emblem covers little of a product."""
MIN_DIFFERENCE = 8.0
"""The least that the largest contradiction counts: of a sibling it may be all that differs."""


@dataclass(frozen=True, eq=False)
class Query:
    """One view that was asked, with the evidence for every candidate."""

    kind: str
    name: str
    store: str
    truth: str | None
    candidates: tuple[tuple[str, Evidence, PrintEvidence | None], ...]

    @property
    def brand(self) -> str:
        return self.name.split("-")[0].split(",")[0]


class Photographs:
    """Photographs of a folder, described under a mask of the middle 60 % of their width."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[tuple[Path, bool], ViewFeatures] = {}

    def some(self, part: str, per_class: int, rng: random.Random, mirrored: bool = False) -> Views:
        """Return so many views of every class, by the name of what is printed on it."""
        views: Views = {}
        for kind in sorted(path for path in (self._folder / part).iterdir() if path.is_dir()):
            files = sorted(kind.glob("*.jpg"))
            for file in rng.sample(files, min(per_class, len(files))):
                name = SAME_PRINT.get(kind.name, kind.name)
                views.setdefault(name, []).append(self._described(file, mirrored))
        return views

    def _described(self, file: Path, mirrored: bool) -> ViewFeatures:
        if (file, mirrored) not in self._known:
            rgb = np.asarray(cv2.imread(str(file)))[:, :: -1 if mirrored else 1, ::-1]
            mask = np.zeros(rgb.shape[:2], bool)
            high, wide = mask.shape
            mask[int(0.04 * high) : int(0.96 * high), int(0.2 * wide) : int(0.8 * wide)] = True
            self._known[file, mirrored] = describe_view(np.ascontiguousarray(rgb), mask)
        return self._known[file, mirrored]


def asked_of(
    stored: Views,
    asked: dict[str, Views],
    known: int,
    views: int,
    seed: int,
    takes_out: bool = False,
) -> list[Query]:
    """Store ``views`` of so many objects and ask; only queries of ``asked`` as they are count.

    With ``takes_out`` each stored object is asked once more while it is not stored.
    """
    rng = random.Random(seed)
    index = RecognitionIndex()
    names = set(rng.sample(sorted(stored), known))
    chosen = {n: rng.sample(stored[n], min(views, len(stored[n]))) for n in sorted(names)}
    for name in chosen:
        _store(index, name, chosen[name])
    recogniser = Recogniser(index)
    queries = []
    for kind, shown in asked.items():
        store = f"{kind}, {known} known, {views} views"
        for name, mine in shown.items():
            is_genuine = name in names and kind not in ("mirrored", "produce")
            truth = name if is_genuine else None
            queries += [Query(kind, name, store, truth, _found(recogniser, q)) for q in mine]
        for name in chosen if takes_out else ():
            for k in range(len(chosen[name])):
                index.remove(f"{name}/{k}")
            queries += [Query(kind, name, store, None, _found(recogniser, q)) for q in shown[name]]
            _store(index, name, chosen[name])
    return queries


def _store(index: RecognitionIndex, name: str, views: list[ViewFeatures]) -> None:
    for k, view in enumerate(views):
        index.add(f"{name}/{k}", name, "class", view)
    index.save()


def _found(
    recogniser: Recogniser, query: ViewFeatures
) -> tuple[tuple[str, Evidence, PrintEvidence | None], ...]:
    snapshot = recogniser.index.snapshot()
    return tuple(
        (
            snapshot.object_iris[one.object_number],
            one.evidence,
            one.printed.evidence if one.printed is not None else None,
        )
        for one in recogniser.gather(query, snapshot)
    )


def gather_photographs(folder: Path, per_class: int) -> list[Query]:
    photographs = Photographs(folder)
    rng = random.Random(7)
    stored = photographs.some("stored", 2 * per_class, rng)
    produce = photographs.some("negatives", 1, rng)
    queries = []
    stores = ((10, 1), (10, 1), (10, 3), (10, 5), (10, 5), (3, 5), (5, 5), (5, 5))
    for seed, (known, views) in enumerate(stores):
        draw = random.Random(seed)
        asked = {
            "photograph": photographs.some("asked", per_class, draw),
            "mirrored": photographs.some("asked", 1, draw, mirrored=True),
            "produce": produce,
        }
        queries += asked_of(stored, asked, known, views, seed)
    return queries


def gather_cartons(count: int) -> list[Query]:
    """Ask for the fronts of cartons, of which the front alone is stored or all sides."""
    rng, cards = np.random.default_rng(300), families(count, 300)
    stored = {card.name: [described(card.print_, rng) for _ in range(5)] for card in cards}
    asked = {card.name: [described(card.print_, rng) for _ in range(2)] for card in cards}
    backs = zip(cards, families(count, 350), strict=True)
    around = {card.name: [described(back.print_, rng) for _ in range(4)] for card, back in backs}
    known, queries = 2 * len(cards) // 3, []
    for draw, views in enumerate((1, 3, 5, 5)):
        queries += asked_of(stored, {"carton": asked}, known, views, draw)
    for draw, fronts in enumerate((1, 3)):
        mixed = {name: stored[name][:fronts] + around[name][fronts - 1 :] for name in stored}
        queries += asked_of(mixed, {"carton": asked}, known, 5, 4 + draw)
    return queries


def gather_renders(
    folder: Path,
    is_wanted: Callable[[str], bool],
    cache: Path | None,
    seen: Callable[[ViewFeatures], ViewFeatures] = without_depth,
    counts: Sequence[int] = (8, 3, 1, 18),
    takes_out: bool = False,
) -> list[Query]:
    """Ask for views of groups of ten objects of which eight are stored."""
    names = [name for name in ycb_names(folder) if is_wanted(name)]
    names = random.Random(99).sample(names, len(names))
    queries = []
    for first in range(0, len(names), GROUP):
        views = {
            name: [seen(v) for v in described_views(folder, name, STEP_DEG, 0, cache)]
            for name in names[first : first + GROUP]
        }
        for seed, count in enumerate(counts):
            rng = random.Random(500 + seed)
            shuffled = {name: rng.sample(mine, 26) for name, mine in views.items()}
            asked = {name: mine[18:24] for name, mine in shuffled.items()}
            stored = {name: mine[:count] for name, mine in shuffled.items()}
            queries += asked_of(stored, {"render": asked}, 8, count, seed, takes_out)
    return queries


def kept(cache: Path | None, part: str, gather: Callable[[], list[Query]]) -> list[Query]:
    """Return a part of the evidence, from the cache where it was gathered before."""
    file = None if cache is None else cache / f"{part}.pickle"
    if file is not None and file.is_file():
        found: list[Query] = pickle.loads(file.read_bytes())
        return found
    found = gather()
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(pickle.dumps(found))
    return found


def fit(queries: list[Query], strength: float) -> list[NDArray[np.float64]]:
    """Return offset and weights for each :attr:`PrintEvidence.support`."""
    rows: list[list[tuple[NDArray[np.float64], bool, float]]] = [[], [], [], []]
    for query in queries:
        for name, _, printed in query.candidates:
            if printed is not None:
                is_right = name == query.truth
                weight = MEANING[query.kind] * (1.0 if is_right else WRONG_COUNTS)
                rows[printed.support].append((print_terms(printed), is_right, weight))
    return [_fitted(group, rows[group], strength) for group in range(4)]


def _fitted(
    group: int, rows: list[tuple[NDArray[np.float64], bool, float]], strength: float
) -> NDArray[np.float64]:
    terms, right, weight = (np.array(column) for column in zip(*rows, strict=True))
    mean, spread = terms.mean(axis=0), terms.std(axis=0) + 1e-9
    scaled = (terms - mean) / spread
    bounds = [(0.0, None) if sign > 0 else (None, 0.0) for sign in PRINT_TERMS.values()]
    extent, difference = (list(PRINT_TERMS).index(term) for term in ("extent", "difference"))
    bounds[extent] = (MIN_EXTENT * spread[extent], None)
    bounds[difference] = (None, -MIN_DIFFERENCE * spread[difference])

    def loss(p: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        z = p[0] + scaled @ p[1:]
        slope = weight * (1 / (1 + np.exp(-z)) - right)
        value = strength * (weight * np.logaddexp(0, np.where(right, -z, z))).sum()
        gradient = strength * np.append(slope.sum(), scaled.T @ slope)
        gradient[1:] += p[1:]
        return value + 0.5 * (p[1:] ** 2).sum(), gradient

    start = np.zeros(1 + len(PRINT_TERMS))
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=[(None, None), *bounds]).x
    slopes = found[1:] / spread
    return np.append(found[0] - slopes @ mean - CAUTION[group], slopes)


def decided(
    query: Query, weights: Weights | None, allows_plain: bool = True
) -> tuple[float, bool, bool]:
    """Return the confidence of the first answer, whether it is right, and whether accepted.

    Without weights print is not compared, and agreeing places decide in the image alone. Unless
    plain things are allowed, print has to confirm them as well.
    """
    constants = ConfidenceParams()
    if weights is None:
        evidence = [
            replace(one, has_print=False, is_plain=False, print_odds=None)
            for _, one, _ in query.candidates
        ]
    else:
        params = PrintParams(tuple(tuple(map(float, group)) for group in weights))
        evidence = [
            one if printed is None else replace(one, print_odds=print_score(printed, params))
            for _, one, printed in query.candidates
        ]
    if not evidence:
        return 0.0, False, False
    if not allows_plain:
        evidence = [replace(one, is_plain=False) for one in evidence]
    sure = confidences(evidence, constants)
    order = np.argsort(-sure, kind="stable")
    _, accepted = decide(sure[order], constants.threshold, constants)
    is_right = query.candidates[int(order[0])][0] == query.truth
    return float(sure[order[0]]), is_right, accepted


def report(
    title: str,
    queries: list[Query],
    weights_of: Callable[[Query], Weights | None],
    allows_plain: bool = True,
) -> None:
    """Print recall and false answers for every sort of store."""
    print(title)
    for store in sorted({query.store for query in queries}):
        mine = [query for query in queries if query.store == store]
        answers = [
            (query.truth is not None, *decided(query, weights_of(query), allows_plain))
            for query in mine
        ]
        known = [(right, accepted) for is_known, _, right, accepted in answers if is_known]
        strange = [accepted for is_known, _, _, accepted in answers if not is_known]
        line = f"  {store:32s}"
        if known:
            found = np.mean([right and accepted for right, accepted in known])
            wrong = np.mean([accepted and not right for right, accepted in known])
            line += f" recall {found:.3f}, wrong {wrong:.3f} of {len(known)}"
        if strange:
            line += f", unknown accepted {np.mean(strange):.3f} of {len(strange)}"
        sure, right = (np.array([answer[k] for answer in answers]) for k in (1, 2))
        print(f"{line}, calibration error {expected_calibration_error(sure, right):.3f}")


def is_fresh(name: str) -> bool:
    """Tell whether no constant was fitted on an object."""
    return not is_fitted(name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--cache", type=Path, help="folder for described renders and the evidence")
    parser.add_argument("--per-class", type=int, default=6, help="photographs asked of each class")
    parser.add_argument("--families", type=int, default=5)
    parser.add_argument("--strength", type=float, default=0.1, help="C of the penalty")
    parser.add_argument("--held-out", action="store_true")
    args = parser.parse_args()
    ycb = ycb_folder()
    if ycb is None:
        parser.error("needs the YCB models: set RTASK_SHARED_DATA to the folder that holds ycb")
    cache: Path | None = args.cache

    def gather_fresh(
        part: str, seen: Callable[[ViewFeatures], ViewFeatures], counts: Sequence[int]
    ) -> list[Query]:
        return kept(cache, part, lambda: gather_renders(ycb, is_fresh, cache, seen, counts, True))

    fitted = kept(cache, "photographs", lambda: gather_photographs(args.photos, args.per_class))
    fitted += kept(cache, "cartons", lambda: gather_cartons(args.families))
    fitted += kept(cache, "renders", lambda: gather_renders(ycb, is_fitted, cache))
    flat = gather_fresh("fresh", without_depth, (8, 3, 1, 18))
    solid = gather_fresh("fresh-depth", lambda view: view, (8, 3))
    shipped = PrintParams().weights
    weights = fit(fitted, args.strength)
    for found in weights:
        print("(" + ", ".join(f"{value:.3g}" for value in found) + ")")
    far = max(float(np.abs(a - b).max()) for a, b in zip(weights, shipped, strict=True))
    print(f"largest distance from the shipped constants: {far:.3g}")
    if args.held_out:
        without = {
            brand: fit([query for query in fitted if query.brand != brand], args.strength)
            for brand in sorted({query.brand for query in fitted if query.kind == "photograph"})
        }
        mine = [query for query in fitted if query.brand in without]
        report(
            "photographs, by a fit without their brand", mine, lambda query: without[query.brand]
        )
    else:
        report("what was fitted, by the shipped constants", fitted, lambda query: shipped)
    for title, queries in (("renders that were not fitted", flat), ("with depth", solid)):
        report(title, queries, lambda query: shipped)
        report(
            "  where print has to confirm plain things too", queries, lambda query: shipped, False
        )
        report("  without comparison of print", queries, lambda query: None)


if __name__ == "__main__":
    main()
