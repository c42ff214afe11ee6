"""Fit the constants of the confidence of print again.

    python tests/benchmarks/fit_print.py --photos FOLDER            # print the constants
    python tests/benchmarks/fit_print.py --photos FOLDER --held-out # families and brands in turn

``FOLDER`` holds ``stored/<class>/*.jpg`` and ``asked/<class>/*.jpg``. Generated cartons
(``generated_prints``) are added; their siblings differ in a known part. A third of the classes
stays unknown in each draw. Of every object that is a candidate the evidence is one row, right or
wrong; for objects with one view, with two or three that verify, and with more, one logistic
function each is fitted, with the sign of every weight held and an L2 penalty (C on standardised
terms).
"""

from __future__ import annotations

import argparse
import random
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from generated_prints import described, families
from numpy.typing import NDArray
from scipy.optimize import minimize

from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view
from features.recognition.comparison.confidence import PRINT_TERMS, print_terms

Views = dict[str, list[ViewFeatures]]
SAME_PRINT = {"Alpro-Fresh-Soy-Milk": "Alpro-Shelf-Soy-Milk"}
"""Two names of one print: no recogniser can tell them apart."""


@dataclass(frozen=True, eq=False)
class Row:
    """One candidate of one query."""

    brand: str
    group: int
    terms: NDArray[np.float64]
    is_right: bool
    weight: float


def photographs(folder: Path, per_class: int, rng: random.Random) -> Views:
    """Describe photographs under a mask of the middle 60 % of their width."""
    views: Views = {}
    for kind in sorted(path for path in folder.iterdir() if path.is_dir()):
        files = sorted(kind.glob("*.jpg"))
        for file in rng.sample(files, min(per_class, len(files))):
            rgb = np.asarray(cv2.imread(str(file)))[:, :, ::-1]
            mask = np.zeros(rgb.shape[:2], bool)
            high, wide = mask.shape
            mask[int(0.04 * high) : int(0.96 * high), int(0.2 * wide) : int(0.8 * wide)] = True
            name = SAME_PRINT.get(kind.name, kind.name)
            views.setdefault(name, []).append(describe_view(np.ascontiguousarray(rgb), mask))
    return views


def generated(count: int, seed: int) -> tuple[Views, Views]:
    """Describe photographs of generated cartons, to store and to ask."""
    rng = np.random.default_rng(seed)
    cards = families(count, seed)
    stored = {card.name: [described(card.print_, rng) for _ in range(5)] for card in cards}
    return stored, {card.name: [described(card.print_, rng) for _ in range(2)] for card in cards}


def candidates(
    stored: Views, asked: Views, views: int, known: int, seed: int, weight: float
) -> list[Row]:
    """Store ``views`` of so many objects, ask all, and return every candidate."""
    rng = random.Random(seed)
    names = sorted(stored)
    index = RecognitionIndex()
    for name in rng.sample(names, known):
        for k, view in enumerate(rng.sample(stored[name], min(views, len(stored[name])))):
            index.add(f"{name}/{k}", name, "class", view)
    recogniser, snapshot = Recogniser(index), index.snapshot()
    rows = []
    for name, queries in asked.items():
        for query in queries:
            for candidate in recogniser.gather(query, snapshot):
                if candidate.printed is None:
                    continue
                e = candidate.printed.evidence
                is_right = snapshot.object_iris[candidate.object_number] == name
                group = 0 if e.verified == 0 else 1 if e.verified < 3 else 2
                rows.append(Row(brand_of(name), group, print_terms(e), is_right, weight))
    return rows


def brand_of(name: str) -> str:
    return name.split("-")[0].split(",")[0]


WRONG_COUNTS = 2.0
"""A wrong candidate weighs so many times a right one."""
CAUTION = 0.5
"""Taken off the offset for several views: a sibling that nobody stored is worse than a question."""
MIN_DIFFERENCE = 6.0
"""The least that a contradiction counts, where the object's own views support the comparison."""


def fit(rows: list[Row], strength: float) -> NDArray[np.float64]:
    """Return offset and weights of one group."""
    terms = np.array([row.terms for row in rows])
    right = np.array([row.is_right for row in rows])
    weight = np.array([row.weight for row in rows]) * np.where(right, 1.0, WRONG_COUNTS)
    mean, spread = terms.mean(axis=0), terms.std(axis=0) + 1e-9
    scaled = (terms - mean) / spread
    bounds = [(0.0, None) if sign > 0 else (None, 0.0) for sign in PRINT_TERMS.values()]
    if rows[0].group > 0:
        at = list(PRINT_TERMS).index("difference")
        bounds[at] = (None, -MIN_DIFFERENCE * spread[at])

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
    offset = found[0] - slopes @ mean - (CAUTION if rows[0].group > 0 else 0.0)
    return np.append(offset, slopes)


def report(rows: list[Row], weights: list[NDArray[np.float64]], title: str) -> None:
    for group, name in enumerate(("one view", "two or three", "four or more")):
        mine = [row for row in rows if row.group == group]
        if not mine or weights[group] is None:
            continue
        z = np.array([weights[group][0] + weights[group][1:] @ row.terms for row in mine])
        right = np.array([row.is_right for row in mine])
        line = f"{title}, {name}: {len(mine)} candidates, {right.sum()} right"
        for least in (0.5, 0.7, 0.9):
            sure = z >= np.log(least / (1 - least))
            line += f"; p >= {least}: {(sure & right).sum()} right {(sure & ~right).sum()} wrong"
        print(line)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--per-class", type=int, default=8)
    parser.add_argument("--families", type=int, default=8)
    parser.add_argument("--strength", type=float, default=1.0, help="C of the penalty")
    parser.add_argument("--held-out", action="store_true")
    args = parser.parse_args()
    rng = random.Random(7)
    stored = photographs(args.photos / "stored", args.per_class, rng)
    asked = photographs(args.photos / "asked", args.per_class, rng)
    prints = generated(args.families, 300)
    rows: list[Row] = []
    for seed, views in enumerate((1, 3, 5, 5)):
        rows += candidates(stored, asked, views, 2 * len(stored) // 3, seed, 3.0)
        rows += candidates(*prints, views, 2 * len(prints[0]) // 3, seed, 0.5)
    if not args.held_out:
        weights = [fit([r for r in rows if r.group == g], args.strength) for g in range(3)]
        for found in weights:
            print("(" + ", ".join(f"{value:.3g}" for value in found) + ")")
        report(rows, weights, "fitted")
        return
    for brand in sorted({row.brand for row in rows}):
        others = [row for row in rows if row.brand != brand]
        weights = [fit([r for r in others if r.group == g], args.strength) for g in range(3)]
        report([row for row in rows if row.brand == brand], weights, f"without {brand}")


if __name__ == "__main__":
    main()
