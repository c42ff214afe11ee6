"""The processor's time of a query from a photograph: cutting it out, describing it, matching it.

    python bench_cold.py --photos FOLDER

``FOLDER`` is as for ``fit_print.py``. Ten products are stored by five photographs each, and two of
every product are asked: first where no stored views were compared with each other, then again.
``OPENBLAS_NUM_THREADS=1`` shows what other threads cost. A digest of the answers
tells whether two versions give the same ones.
"""

from __future__ import annotations

import argparse
import hashlib
import random
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import UInt8Array
from features.imaging.foreground import find_foreground
from features.recognition import Recogniser, RecognitionIndex, describe_view, warm_up

KNOWN, VIEWS, ASKED = 10, 5, 2
Value = TypeVar("Value")
Given = TypeVar("Given")


def timed(title: str, work: Callable[[Given], Value], values: Sequence[Given]) -> list[Value]:
    """Return what a function makes of values, and print the processor's time of each."""
    made: list[Value] = []
    times: list[float] = []
    for value in values:
        before = time.process_time()
        made.append(work(value))
        times.append(1000 * (time.process_time() - before))
    usual, most = float(np.median(times)), float(np.quantile(times, 0.95))
    print(f"{title:28s} median {usual:.0f} ms, 95 % {most:.0f} ms, {len(values)} in all")
    return made


def middle(image: UInt8Array) -> NDArray[np.bool_]:
    """Return the mask of the middle 60 % of the width."""
    high, wide = image.shape[:2]
    mask = np.zeros((high, wide), bool)
    mask[int(0.04 * high) : int(0.96 * high), int(0.2 * wide) : int(0.8 * wide)] = True
    return mask


def read(file: Path) -> UInt8Array:
    return np.ascontiguousarray(np.asarray(cv2.imread(str(file)), np.uint8)[..., ::-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photos", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=5)
    args = parser.parse_args()
    warm_up()
    rng = random.Random(args.seed)
    kinds = sorted(path.name for path in (args.photos / "stored").iterdir() if path.is_dir())

    def some(part: str, kind: str, count: int) -> list[UInt8Array]:
        files = sorted((args.photos / part / kind).glob("*.jpg"))
        return [read(file) for file in rng.sample(files, count)]

    with RecognitionIndex() as index:
        for kind in kinds[:KNOWN]:
            for k, image in enumerate(some("stored", kind, VIEWS)):
                index.add(f"{kind}/{k}", kind, "class", describe_view(image, middle(image)))
            index.save()
        asked = [image for kind in kinds for image in some("asked", kind, ASKED)]
        timed("cut out by colour", find_foreground, asked)
        views = timed("described", lambda image: describe_view(image, middle(image)), asked)
        recogniser = Recogniser(index)
        for title in ("matched, nothing compared", "matched again"):
            answers = timed(title, recogniser.recognise, views)
        told = [
            (answer.accepted, [(m.object_iri, round(m.confidence, 9)) for m in answer.matches])
            for answer in answers
        ]
        print("digest of the answers", hashlib.sha256(repr(told).encode()).hexdigest()[:12])


if __name__ == "__main__":
    main()
