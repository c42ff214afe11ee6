"""Ask for rendered objects with depth in another light than they were stored in.

    python bench_light.py --cache FOLDER           # those that fitted nothing
    python bench_light.py --cache FOLDER --fitted  # the others; the constants

Stores hold eight of ten objects with 8 or 3 views each, all in one light. Asked are other views in
that light, at .6 of its brightness, warmer, cooler, with noise, and with all of these at random,
another gamma, saturation and sharpness as well. Unknown are the other objects, half of the stored
ones while they are taken out, and look-alikes of stored ones on the same mesh: the print shuffled,
its hue turned, tools tinted, which is what another light does. Each query is decided twice, with
its colours as they are and with those in other lights; intervals of 90 %, by resampling objects.
The fit of likeness leaves tinted tools out, holds the sign of both weights, a wrong candidate
weighs five times a right one, and ``_CAUTION`` is taken off the offset. Ten minutes of one core.
"""

from __future__ import annotations

import argparse
import pickle
import random
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view
from features.recognition.candidates import RecogniserParams
from features.recognition.confidence import ConfidenceParams, Evidence, confidences, decide
from tests.benchmarks.recognition.bench_shapes import interval, lookalikes
from tests.benchmarks.recognition.turntable import (
    CAMERA,
    Picture,
    is_fitted,
    render_views,
    ycb_folder,
    ycb_names,
)

Views = dict[str, list[ViewFeatures]]
Candidates = tuple[tuple[str, Evidence], ...]
GAINS = {
    "as stored": (1.0, 1.0, 1.0),
    "dark": (0.6, 0.6, 0.6),
    "warm": (1.15, 1.0, 0.75),
    "cool": (0.82, 1.0, 1.15),
    "noise": (1.0, 1.0, 1.0),
}
RANDOM = ("random 1", "random 2")
GROUP, KNOWN, ASKED, ASKED_ALIKE = 10, 8, 6, 4
_NOISE = 6.0
_STRENGTH, _WRONG_COUNTS, _CAUTION = 0.2, 5.0, 1.57
_ONE_LIGHT = RecogniserParams(confidence=ConfidenceParams(light_gain=9.0, light_tint=9.0))


@dataclass(frozen=True, eq=False)
class Query:
    """One view that was asked, with the evidence for every candidate, without and with lights."""

    name: str
    truth: str | None
    count: int
    light: str
    candidates: tuple[Candidates, Candidates]

    @property
    def sort(self) -> str:
        """Way in which a look-alike was made, nothing for an object."""
        return self.name.partition("~")[2]


def lit(rgb: NDArray[np.uint8], light: str, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return an image (h, w, 3) in another light."""
    if light == "as stored":
        return rgb
    image = rgb.astype(np.float32)
    if light in GAINS:
        image = image * np.array(GAINS[light], np.float32)
        image += rng.normal(0, _NOISE, image.shape) if light == "noise" else 0
    else:
        image = 255 * (image / 255) ** rng.uniform(0.85, 1.18)
        grey = image.mean(axis=2, keepdims=True)
        image = grey + rng.uniform(0.85, 1.15) * (image - grey)
        tint, gain = rng.uniform(-0.3, 0.3), 2 ** rng.uniform(-0.8, 0.4)
        image *= gain * np.array([2**tint, rng.uniform(0.96, 1.04), 2**-tint])
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.2))
        image = image + rng.normal(0, rng.uniform(1, 6), image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


def described(
    folder: Path, name: str, cache: Path, models: Path, half: int
) -> tuple[list[ViewFeatures], Views]:
    """Return the views to store of an object, none of a look-alike, and those asked by light."""
    file = cache / f"{name}.pickle"
    if not file.is_file():
        rng = np.random.default_rng([half, *name.encode()])
        if "~" in name:
            stored: list[bytes] = []
            shots = list(render_views(models, name, 90, 5300 + half, 31.0, (0.35,)))
        else:
            seen = render_views(folder, name, 30, 5100 + half, 7.0)
            stored = [shot.describe().to_bytes() for shot in seen]
            shots = list(render_views(folder, name, 60, 5200 + half, 19.0, (0.3, 0.55)))
        most = min(ASKED_ALIKE if "~" in name else ASKED, len(shots))
        chosen = [shots[k] for k in rng.choice(len(shots), most, replace=False)]
        asked = {light: _described(chosen, light, rng) for light in (*GAINS, *RANDOM)}
        file.write_bytes(pickle.dumps((stored, asked)))
    stored, asked = pickle.loads(file.read_bytes())
    again = ViewFeatures.from_bytes
    return [again(data) for data in stored], {
        light: [again(data) for data in views] for light, views in asked.items()
    }


def _described(shots: list[Picture], light: str, rng: np.random.Generator) -> list[bytes]:
    return [
        describe_view(lit(shot.rgb(), light, rng), shot.mask, shot.depth_m, CAMERA).to_bytes()
        for shot in shots
    ]


def gather(folder: Path, cache: Path, half: int) -> list[Query]:
    """Store and ask."""
    names = [name for name in ycb_names(folder) if is_fitted(name) == bool(half)]
    models = cache / "lookalikes"
    others = [other for name in names for other in lookalikes(folder, name, models)]
    views = {name: described(folder, name, cache, models, half) for name in (*names, *others)}
    queries: list[Query] = []
    order = random.Random(0).sample(names, len(names))
    for first in range(0, len(order) - 4, GROUP):
        group = order[first : first + GROUP]
        for count in (8, 3):
            rng = random.Random(f"0{first}{count}")
            known = rng.sample(group, min(KNOWN, len(group) - 2))
            stored = {name: rng.sample(views[name][0], count) for name in known}
            alike = [other for other in others if other.split("~")[0] in known]
            queries += _asked(stored, [*group, *alike], known[: KNOWN // 2], views)
    return queries


def _asked(
    stored: Views,
    names: Sequence[str],
    taken_out: Sequence[str],
    views: dict[str, tuple[list[ViewFeatures], Views]],
) -> list[Query]:
    """Ask one store for all names, then for some of its objects while they are taken out."""
    index = RecognitionIndex()
    both = (Recogniser(index, _ONE_LIGHT), Recogniser(index))
    count = len(next(iter(stored.values())))

    def put(name: str) -> None:
        for k, view in enumerate(stored[name]):
            index.add(f"{name}/{k}", name, "class:ycb", view)

    def ask(name: str, truth: str | None) -> list[Query]:
        return [
            Query(name, truth, count, light, (_evidence(both[0], query), _evidence(both[1], query)))
            for light, mine in views[name][1].items()
            for query in mine
        ]

    for name in stored:
        put(name)
    found = [query for name in names for query in ask(name, name if name in stored else None)]
    for name in taken_out:
        for k in range(count):
            index.remove(f"{name}/{k}")
        found += ask(name, None)
        put(name)
    return found


def _evidence(recogniser: Recogniser, query: ViewFeatures) -> Candidates:
    snapshot = recogniser.index.snapshot()
    return tuple(
        (snapshot.object_iris[one.object_number], one.evidence)
        for one in recogniser.gather(query, snapshot)
    )


def decided(candidates: Candidates) -> str | None:
    """Return the object that is accepted."""
    if not candidates:
        return None
    constants = ConfidenceParams()
    sure = confidences([evidence for _, evidence in candidates], constants)
    order = np.argsort(-sure, kind="stable")
    _, accepted = decide(sure[order], constants.threshold, constants)
    return candidates[int(order[0])][0] if accepted else None


def report(queries: list[Query]) -> None:
    """Print recall and false answers in each light."""
    for count in (8, 3):
        for light in (*GAINS, *RANDOM, "all but as stored"):
            wanted = (light,) if light in (*GAINS, *RANDOM) else (*GAINS, *RANDOM)[1:]
            mine = [q for q in queries if q.count == count and q.light in wanted]
            line = f"{count} views, {light:18s}"
            answers = [tuple(decided(c) for c in query.candidates) for query in mine]
            for which, title in enumerate(("one light", "lights")):
                pairs = [
                    (query, answer[which]) for query, answer in zip(mine, answers, strict=True)
                ]
                known = [(q, a) for q, a in pairs if q.truth is not None]
                right = np.mean([a == q.truth for q, a in known])
                wrong = sum(a not in (None, q.truth) for q, a in known)
                line += f" {title}: recall {right:.3f} of {len(known)}, wrong {wrong}"
                for sort in ("", "shuffle", "hue", "tint"):
                    strange = [a for q, a in pairs if q.truth is None and q.sort == sort]
                    false = sum(a is not None for a in strange)
                    line += f", {sort or 'unknown'} {false} of {len(strange)}"
                line += ";"
            gains = [
                (query.name, float(answer[1] == query.truth) - float(answer[0] == query.truth))
                for query, answer in zip(mine, answers, strict=True)
                if query.truth is not None
            ]
            print(f"{line} recall {interval(gains)}")


def fit(queries: list[Query]) -> None:
    """Print offset and weights of likeness and its lead, beside the shipped ones."""
    constants = ConfidenceParams()
    terms, right = [], []
    for query in queries:
        for name, e in query.candidates[1] if query.sort != "tint" else ():
            # Where the look may decide at all; what print has to confirm says nothing of it.
            is_plain = e.is_plain and (e.print_odds or 0.0) >= constants.contradicting_odds
            if e.size_ok and e.likeness is not None and is_plain:
                lead = np.clip(e.likeness_lead, -constants.max_like_lead, constants.max_like_lead)
                terms.append((e.likeness, lead))
                right.append(name == query.truth)
    found, is_right = np.array(terms), np.array(right)
    mean, scale = found.mean(axis=0), found.std(axis=0)
    scaled = (found - mean) / scale
    weight = np.where(is_right, 1.0, _WRONG_COUNTS)

    def loss(p: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        z = p[0] + scaled @ p[1:]
        slope = _STRENGTH * weight * (1 / (1 + np.exp(-z)) - is_right)
        value = _STRENGTH * (weight * np.logaddexp(0, np.where(is_right, -z, z))).sum()
        gradient = np.append(slope.sum(), scaled.T @ slope + p[1:])
        return value + 0.5 * (p[1:] ** 2).sum(), gradient

    bounds = [(None, None), (0.0, None), (0.0, None)]
    best = minimize(loss, np.zeros(3), jac=True, method="L-BFGS-B", bounds=bounds).x
    weights = best[1:] / scale
    offset = best[0] - weights @ mean - _CAUTION
    print(
        f"fitted: offset {offset:.2f}, likeness {weights[0]:.2f}, lead {weights[1]:.2f}; ", end=""
    )
    print(f"shipped: {constants.like_offset}, {constants.like_own}, {constants.like_lead}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cache", type=Path, required=True, help="folder for views and evidence")
    parser.add_argument("--fitted", action="store_true", help="the half that is fitted on")
    args = parser.parse_args()
    folder = ycb_folder()
    if folder is None:
        parser.error("needs the YCB models: set RTASK_SHARED_DATA to the folder that holds ycb")
    args.cache.mkdir(parents=True, exist_ok=True)
    file = args.cache / f"evidence-{int(args.fitted)}.pickle"
    if not file.is_file():
        file.write_bytes(pickle.dumps(gather(folder, args.cache, int(args.fitted))))
    queries: list[Query] = pickle.loads(file.read_bytes())
    report(queries)
    if args.fitted:
        fit(queries)


if __name__ == "__main__":
    main()
