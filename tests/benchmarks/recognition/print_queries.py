"""Queries with the evidence of print for every candidate: photographs, cartons, renders.

``fit_print.py`` fits on some of them, and decides others.
"""

from __future__ import annotations

import hashlib
import pickle
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

import features
from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view
from features.recognition.comparison.evidence import PrintEvidence
from features.recognition.confidence import Evidence
from tests.benchmarks.recognition.generated_prints import described, families
from tests.benchmarks.recognition.turntable import described_views, without_depth, ycb_names

Views = dict[str, list[ViewFeatures]]
SAME_PRINT = {"Alpro-Fresh-Soy-Milk": "Alpro-Shelf-Soy-Milk"}
"""Two names of one print: no recogniser can tell them apart."""
STEP_DEG, GROUP = 30, 10
"""Between the views of a render; and so many objects are asked together."""


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
    seals: bool = False,
) -> list[Query]:
    """Store ``views`` of so many objects and ask; only queries of ``asked`` as they are count.

    With ``takes_out`` each stored object is asked once more while it is not stored. Then, and with
    ``seals``, the index is sealed after each object, else once, when all are stored: that decides
    which keypoints vote. The shipped constants were fitted on stores that were sealed once.
    """
    rng = random.Random(seed)
    index = RecognitionIndex()
    names = set(rng.sample(sorted(stored), known))
    chosen = {n: rng.sample(stored[n], min(views, len(stored[n]))) for n in sorted(names)}
    for name in chosen:
        _store(index, name, chosen[name], seals or takes_out)
    if not (seals or takes_out):
        index.save()
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
            _store(index, name, chosen[name], seals=True)
    return queries


def _store(index: RecognitionIndex, name: str, views: list[ViewFeatures], seals: bool) -> None:
    for k, view in enumerate(views):
        index.add(f"{name}/{k}", name, "class", view)
    if seals:
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


def gather_photographs(folder: Path, per_class: int, seals: bool = False) -> list[Query]:
    """Ask for photographs, mirrored ones and produce."""
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
        queries += asked_of(stored, asked, known, views, seed, seals=seals)
    return queries


def gather_cartons(
    count: int, seed: int = 300, mirrors: bool = False, seals: bool = False
) -> list[Query]:
    """Ask for the fronts of cartons, of which the front alone is stored or all sides."""
    rng, cards = np.random.default_rng(seed), families(count, seed)
    stored = {card.name: [described(card.print_, rng) for _ in range(5)] for card in cards}
    asked = {"carton": {card.name: [described(card.print_, rng) for _ in "ab"] for card in cards}}
    backs = zip(cards, families(count, seed + 50), strict=True)
    around = {card.name: [described(back.print_, rng) for _ in range(4)] for card, back in backs}
    if mirrors:
        turned = {card.name: np.ascontiguousarray(card.print_[:, ::-1]) for card in cards}
        asked["mirrored"] = {name: [described(turned[name], rng)] for name in turned}
    known, queries = 2 * len(cards) // 3, []
    for draw, views in enumerate((1, 3, 5, 5)):
        queries += asked_of(stored, asked, known, views, draw, seals=seals)
    for draw, fronts in enumerate((1, 3)):
        mixed = {name: stored[name][:fronts] + around[name][fronts - 1 :] for name in stored}
        found = asked_of(mixed, asked, known, 5, 4 + draw, seals=seals)
        queries += [replace(query, store=f"{query.store}, all sides") for query in found]
    return queries


def gather_renders(
    folder: Path,
    is_wanted: Callable[[str], bool],
    cache: Path | None,
    seen: Callable[[ViewFeatures], ViewFeatures] = without_depth,
    counts: Sequence[int] = (8, 3, 1, 18),
    takes_out: bool = False,
    seals: bool = False,
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
            queries += asked_of(stored, {"render": asked}, 8, count, seed, takes_out, seals)
    return queries


def folder_for_code(cache: Path) -> Path:
    """Return a folder in the cache for evidence by the code as it stands.

    Evidence of other code is never fitted: constants have been shipped that the command no longer
    printed, because its cache had outlived a change of how stores are filled.
    """
    roots = (Path(features.__file__).parent, Path(__file__).parent)
    digest = hashlib.sha256()
    for file in sorted(file for root in roots for file in root.rglob("*.py")):
        digest.update(file.read_bytes())
    return cache / digest.hexdigest()[:12]


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
