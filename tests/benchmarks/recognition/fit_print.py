"""Fit the constants of the confidence of print, and say what they are worth on what was left out.

    python fit_print.py --photos FOLDER --cache FOLDER             # the constants
    python fit_print.py --photos FOLDER --cache FOLDER --held-out  # brands in turn
    python fit_print.py --photos FOLDER --cache FOLDER --left-out --sealed  # two sets compared

``FOLDER`` holds ``stored/<class>/*.jpg``, ``asked/<class>/*.jpg`` and ``negatives/<kind>/*.jpg``.
Three sources are asked against stores of 2 to 10 objects with 1 to 5 views (renders: 1 to 18):
photographs under a mask of the middle 60 % of their width, mirrored ones among the unknown;
generated cartons (``generated_prints``) whose siblings differ in a known part; renders of the
fitted half of the YCB objects (``turntable.is_fitted``) without depth. Each candidate of a query is
one row, right or wrong. For each support by the object's other views (``PrintEvidence.support``)
one logistic function is fitted, with the sign of every weight held, the least weight of two of
them, and an L2 penalty (C on standardised terms). Where a constant differs from the shipped one,
both are printed; to the digits shipped, none does. What is reported are decisions, as a recogniser
with the shipped constants takes them; ``--held-out`` decides each photograph by a fit without its
brand. The other half of the YCB objects is never fitted; it is asked with and without depth, and
each object once more while it is taken out of the store, as one of the unknown. With ``--sealed``
the fit is on stores whose index is sealed after each object, not once: it gives other constants.
``--left-out`` decides what neither set was fitted on by both (``left_out``). ``--cache`` keeps
described renders and the evidence until the code changes: to gather either takes ten minutes of
one core.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from features.recognition import ViewFeatures
from features.recognition.comparison.confidence import (
    PRINT_TERMS,
    PrintParams,
    print_score,
    print_terms,
)
from features.recognition.confidence import ConfidenceParams, confidences, decide
from features.recognition.metrics import expected_calibration_error
from tests.benchmarks.recognition.left_out import compare, left_out
from tests.benchmarks.recognition.print_queries import (
    Query,
    folder_for_code,
    gather_cartons,
    gather_photographs,
    gather_renders,
    kept,
)
from tests.benchmarks.recognition.turntable import is_fitted, without_depth, ycb_folder

Weights = Sequence[Sequence[float]]
MEANING = {"photograph": 3.0, "mirrored": 3.0, "produce": 3.0, "carton": 1.0, "render": 1.0}
"""Weight of a row by the kind of its query."""
WRONG_COUNTS = 2.0
"""A wrong candidate weighs so many times a right one."""
CAUTION = (1.0, 0.4, 0.7, 0.9)
"""Taken off the offset: a sibling that nobody stored is worse than a question."""
SUPPORT = ("one view", "others show other sides", "two or three agree", "more agree")
"""Meaning of :attr:`PrintEvidence.support`."""
MIN_EXTENT = 3.0
"""The least that the area between the matches counts: an emblem covers little of a product."""
MIN_DIFFERENCE = 8.0
"""The least that the largest contradiction counts: of a sibling it may be all that differs."""


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


def print_difference(weights: Weights, shipped: Weights) -> None:
    """Print each constant that was fitted now, where another is shipped beside that."""
    for group, (now, before) in enumerate(zip(weights, shipped, strict=True)):
        print(f"{SUPPORT[group]}: fitted now")
        print("  (" + ", ".join(f"{value:.3g}" for value in now) + ")")
        changed = [
            f"{term} {old:.3g} -> {new:.3g}"
            for term, new, old in zip(("offset", *PRINT_TERMS), now, before, strict=True)
            if f"{new:.3g}" != f"{old:.3g}"
        ]
        print("  other than shipped: " + (", ".join(changed) or "none"))
    far = max(
        abs(a - b)
        for now, old in zip(weights, shipped, strict=True)
        for a, b in zip(now, old, strict=True)
    )
    print(f"largest distance from the shipped constants: {far:.3g}")


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
    parser.add_argument("--sealed", action="store_true", help="seal stores after each object")
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--held-out", action="store_true", help="brands in turn")
    shown.add_argument("--left-out", action="store_true", help="compare both sets of constants")
    args = parser.parse_args()
    ycb = ycb_folder()
    if ycb is None:
        parser.error("needs the YCB models: set RTASK_SHARED_DATA to the folder that holds ycb")
    cache = None if args.cache is None else folder_for_code(args.cache)

    def gather_fresh(
        part: str, seen: Callable[[ViewFeatures], ViewFeatures], counts: Sequence[int]
    ) -> list[Query]:
        return kept(cache, part, lambda: gather_renders(ycb, is_fresh, cache, seen, counts, True))

    sources: dict[str, Callable[[], list[Query]]] = {
        "photographs": lambda: gather_photographs(args.photos, args.per_class, args.sealed),
        "cartons": lambda: gather_cartons(args.families, seals=args.sealed),
        "renders": lambda: gather_renders(ycb, is_fitted, cache, seals=args.sealed),
    }
    fitted = [
        query
        for part, gather in sources.items()
        for query in kept(cache, f"{part}-sealed" if args.sealed else part, gather)
    ]
    shipped = PrintParams().weights
    weights = [tuple(group.tolist()) for group in fit(fitted, args.strength)]
    print_difference(weights, shipped)
    if args.left_out:
        for title, queries in left_out(ycb, args.families, cache).items():
            compare(
                f"{title}: shipped constants, those fitted now",
                queries,
                lambda query: decided(query, shipped),
                lambda query: decided(query, weights),
            )
        return
    flat = gather_fresh("fresh", without_depth, (8, 3, 1, 18))
    solid = gather_fresh("fresh-depth", lambda view: view, (8, 3))
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
