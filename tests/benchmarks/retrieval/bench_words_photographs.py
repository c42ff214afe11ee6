"""Photographs of cartons without a mask, with and without reading their words (extra ``words``).

    python bench_words_photographs.py --photos FOLDER --seed 1 --draws 6

``FOLDER`` is as for ``fit_print.py``. In each draw ten products are stored by five photographs
each, and eight of every product are asked, cut from their background by colour. An answer that a
word refutes would have been accepted without words, so that one run decides both ways. A photograph
is read when a draw first needs it. Intervals of 90 %, by resampling products. What was to hold is
that of ``bench_words.py``, and the last line says whether it does.
"""

from __future__ import annotations

import argparse
import random
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.imaging.foreground import find_foreground
from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, describe_view, warm_up
from features.recognition.recogniser import Recognition
from features.words.contradiction import WordContradiction, contradicting_word
from features.words.rapid import RapidReader
from features.words.word import Word, words_of_view
from tests.benchmarks.recognition.print_queries import SAME_PRINT
from tests.benchmarks.retrieval.bench_words import Asked, report, verdict

KNOWN, VIEWS, SHOTS = 10, 5, 8


class Photographs:
    """Photographs of a folder, described and read once each, when first needed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._views: dict[Path, ViewFeatures] = {}
        self._words: dict[Path, tuple[Word, ...]] = {}
        self._reader = RapidReader()

    def of_products(self, part: str) -> dict[str, list[Path]]:
        """Return the files of every product, by the name of what is printed on it."""
        files: dict[str, list[Path]] = {}
        for kind in sorted(path for path in (self._folder / part).iterdir() if path.is_dir()):
            name = SAME_PRINT.get(kind.name, kind.name)
            files.setdefault(name, []).extend(sorted(kind.glob("*.jpg")))
        return files

    def view(self, file: Path) -> ViewFeatures:
        if file not in self._views:
            rgb, mask = self._cut(file)
            self._views[file] = replace(describe_view(rgb, mask), is_mask_guessed=True)
        return self._views[file]

    def words(self, file: Path) -> tuple[Word, ...]:
        if file not in self._words:
            self._words[file] = words_of_view(self._reader, *self._cut(file))
        return self._words[file]

    @staticmethod
    def _cut(file: Path) -> tuple[UInt8Array, NDArray[np.bool_]]:
        rgb = np.ascontiguousarray(np.asarray(cv2.imread(str(file)), np.uint8)[..., ::-1])
        return rgb, find_foreground(rgb)


def refuting_word(
    answer: Recognition, file: Path, stored: dict[str, Path], photographs: Photographs
) -> WordContradiction | None:
    """Return the word that refutes an accepted answer, as the engine would."""
    first = answer.matches[0]
    if first.homography is None:
        return None
    views = [other for other in stored if other.rsplit("/", 1)[0] == first.object_iri]
    texts = {word.text for view in views for word in photographs.words(stored[view])}
    there = photographs.words(stored[first.view_iri])
    if not there:
        return None
    return contradicting_word(photographs.words(file), there, texts, first.homography)


def ask_draw(photographs: Photographs, seed: int) -> list[Asked]:
    """Store ten products and ask for all."""
    rng = random.Random(f"words {seed}")
    taught, shown = photographs.of_products("stored"), photographs.of_products("asked")
    numbers = {name: number for number, name in enumerate(sorted(taught))}
    known = sorted(rng.sample(sorted(taught), KNOWN))
    stored: dict[str, Path] = {}
    asked: list[Asked] = []
    with RecognitionIndex() as index:
        for name in known:
            for k, file in enumerate(rng.sample(taught[name], VIEWS)):
                stored[f"{name}/{k}"] = file
                index.add(f"{name}/{k}", name, "class", photographs.view(file))
            index.save()
        recogniser = Recogniser(index)
        for name, number in numbers.items():
            for file in rng.sample(shown[name], SHOTS):
                answer = recogniser.recognise(photographs.view(file))
                told = refuting_word(answer, file, stored, photographs) if answer.accepted else None
                is_first = bool(answer.matches) and answer.matches[0].object_iri == name
                accepted = answer.accepted and told is None
                asked.append(Asked(number, name in known, is_first, accepted, told is not None))
                if told is not None or (accepted and not (is_first and name in known)):
                    named = answer.matches[0].object_iri
                    words = f'"{told.seen.text}", "{told.stored.text}"' if told else "accepted"
                    print(f"  {name} taken for {named}: {words}, {file.name}")
    return asked


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1, help="of the first draw")
    parser.add_argument("--draws", type=int, default=6)
    args = parser.parse_args()
    warm_up()
    photographs, asked = Photographs(args.photos), list[Asked]()
    for draw in range(args.draws):
        asked += ask_draw(photographs, args.seed + draw)
        print(f"{draw + 1} draws")
        unknown, lost = report(asked)
    print(verdict(unknown, lost))


if __name__ == "__main__":
    main()
