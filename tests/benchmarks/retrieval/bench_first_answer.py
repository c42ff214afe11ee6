"""The first answer of a fresh process among many stored views, ours and faiss in the same run.

    python bench_first_answer.py --images FOLDER                 # 100,000 views
    python bench_first_answer.py --images FOLDER --views 10000

Generated covers are stored by one scan each, among views whose descriptors are put together from
pieces of those of the images (``bench_coarse.py``); photographs of the covers are asked. Each
structure is opened from its files by a process of its own, which asks all photographs and says what
opening, the first answer and the others took of the processor. Files are dropped from the cache of
the system before (``posix_fadvise``), so that the clock of a cold start has the disk in it. Rounds
alternate between the structures; one thread each.

*whole answer*: matching, geometry and the comparison of print. *our tables* and *faiss*: the coarse
stage alone, from a query's descriptors to the object with most votes, on the same 128-bit codes,
with the same exact distances of what is found. faiss reads its index into memory, ours is mapped.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # one thread of either side is timed

import numpy as np
from numpy.typing import NDArray

from features.recognition import (
    Recogniser,
    RecognitionIndex,
    ViewFeatures,
    describe_view,
    warm_up,
)
from tests.benchmarks.recognition.bench_coarse import VIEWS_OF_EACH, cells_of, drawn, seen
from tests.benchmarks.recognition.bench_index_scale import NEIGHBOURS, winner, winner_of
from tests.benchmarks.recognition.generated_packages import Phone, artwork, photograph_cover, scan

STRUCTURES = ("whole answer", "our tables", "faiss BinaryIVF", "faiss BinaryFlat")
PROBES = 8
"""Cells that are asked: the fewest that find as much as our tables do."""
Asked = list[tuple[int, ViewFeatures]]


def covers(count: int, seed: int) -> tuple[list[ViewFeatures], Asked]:
    """Return the scans of covers, and a photograph of each with the number of its cover."""
    rng = np.random.default_rng([9, seed])
    prints = [artwork(1000 * seed + k) for k in range(count)]
    flat = [scan(print_) for print_ in prints]
    stored = [describe_view(image, np.ones(image.shape[:2], bool)) for image in flat]
    asked = []
    for k, print_ in enumerate(prints):
        image, mask = photograph_cover(print_, Phone.of(40 * seed + k), rng)
        asked.append((k, describe_view(image, mask)))
    return stored, asked


def other_views(cells: NDArray[np.float32], views: int, rows: int) -> Iterator[ViewFeatures]:
    """Yield views of other objects, ten of each, one object after the other."""
    plain = describe_view(np.full((64, 64, 3), 128, np.uint8), np.ones((64, 64), bool))
    for number in range(-(-views // VIEWS_OF_EACH)):
        rng = np.random.default_rng([7, number])
        base = drawn(cells, rows, rng)
        places = np.column_stack(
            [rng.uniform(0, 64, (rows, 2)), np.full(rows, 5), np.zeros(rows)]
        ).astype(np.float32)
        colour, hog = (rng.gamma(0.4, 1, each.shape) for each in (plain.colour, plain.hog))
        for _ in range(VIEWS_OF_EACH):
            yield replace(
                plain, keypoints=places, descriptors=seen(base, rng), picture=b"",
                colour=(colour / np.linalg.norm(colour)).astype(plain.colour.dtype),
                hog=(hog / np.linalg.norm(hog)).astype(plain.hog.dtype),
                points3d=np.full((rows, 3), np.nan, np.float32),
            )  # fmt: skip


def make(args: argparse.Namespace, folder: Path) -> None:
    """Write both structures and the queries into a folder, and print what making them takes."""
    import faiss

    stored, asked = covers(args.queries, args.seed)
    (folder / "asked.pickle").write_bytes(pickle.dumps([(k, v.to_bytes()) for k, v in asked]))
    rest = other_views(cells_of(args.images), args.views - len(stored), args.descriptors)
    start = time.process_time()
    index, rows, labels = RecognitionIndex(), [], []
    for k, view in enumerate((*stored, *rest)):
        number = k if k < len(stored) else len(stored) + (k - len(stored)) // VIEWS_OF_EACH
        index.add(f"v:{k}", f"o:{number}", "class:x", view)
        rows.append(view.descriptors)
        labels.append(np.full(len(view), number, np.int32))
    hasher = index.snapshot().hasher
    _write(index, folder / "index")
    print(f"{args.views} views, {sum(map(len, rows))} descriptors, load {os.getloadavg()[0]:.0f}")
    print(f"our index made in {time.process_time() - start:.0f} s of the processor", flush=True)
    every = np.concatenate(rows)
    np.save(folder / "descriptors.npy", every)
    np.save(folder / "labels.npy", np.concatenate(labels))
    codes = hasher.encode(every)[0].view(np.uint8).reshape(-1, 16)
    faiss.omp_set_num_threads(1)
    start = time.process_time()
    flat = faiss.IndexBinaryFlat(128)
    cells = int(np.clip(len(codes) // 300, 16, 4096))
    inverted = faiss.IndexBinaryIVF(flat, 128, cells)
    inverted.cp.niter = 6
    inverted.train(codes[:: max(1, len(codes) // (40 * cells))])
    inverted.add(codes)
    inverted.nprobe = PROBES
    faiss.write_index_binary(inverted, str(folder / "BinaryIVF"))
    print(f"faiss BinaryIVF made in {time.process_time() - start:.0f} s", flush=True)
    whole = faiss.IndexBinaryFlat(128)
    whole.add(codes)
    faiss.write_index_binary(whole, str(folder / "BinaryFlat"))


def _write(index: RecognitionIndex, path: Path) -> None:
    """Write an index that was made in memory, as a rebuild does."""
    from features.recognition.index.folder import IndexFolder

    index.save()
    folder = IndexFolder(path, writable=True)
    folder.write_header(index._hasher)
    index._commit(folder, index._pieces())
    index.close()
    folder.release()


def opened(structure: str, folder: Path) -> Callable[[ViewFeatures], int]:
    """Return what gives the number of the object of a query, -1 for none."""
    if structure.startswith("faiss"):
        return _opened_faiss(structure.split()[1], folder)
    index = RecognitionIndex(folder / "index")
    snapshot = index.snapshot()
    if structure == "our tables":

        def voted(view: ViewFeatures) -> int:
            found = snapshot.match(view.descriptors)
            labels = np.where(found.view >= 0, snapshot.object_of_view[found.view], -1)
            best = winner(labels, found.nearest, found.rival)
            return -1 if best < 0 else int(snapshot.object_iris[best][2:])

        return voted
    recogniser = Recogniser(index)

    def answered(view: ViewFeatures) -> int:
        matches = recogniser.recognise(view).matches
        return int(matches[0].object_iri[2:]) if matches else -1

    return answered


def _opened_faiss(name: str, folder: Path) -> Callable[[ViewFeatures], int]:
    import faiss

    from features.recognition.index.hashing import Hasher

    faiss.omp_set_num_threads(1)
    hasher = Hasher.seeded()
    index = faiss.read_index_binary(str(folder / name))
    descriptors = np.load(folder / "descriptors.npy", mmap_mode="r")
    labels = np.load(folder / "labels.npy", mmap_mode="r")

    def voted(view: ViewFeatures) -> int:
        codes = hasher.encode(view.descriptors)[0].view(np.uint8).reshape(-1, 16)
        _, rows = index.search(codes, NEIGHBOURS)
        apart = descriptors[rows].astype(np.int32) - view.descriptors[:, None].astype(np.int32)
        return winner_of((rows, (apart**2).sum(axis=2)), labels)

    return voted


def ask(structure: str, folder: Path) -> dict[str, Any]:
    """Open a structure, ask all, and return what it took: ms of the processor, s of the clock."""
    asked = [
        (k, ViewFeatures.from_bytes(data))
        for k, data in pickle.loads((folder / "asked.pickle").read_bytes())
    ]
    warm_up()
    if structure.startswith("faiss"):
        import faiss  # importing a library is no part of opening what it made

        assert faiss
    clock, start = time.perf_counter(), time.process_time()
    find = opened(structure, folder)
    opening = 1e3 * (time.process_time() - start)
    took, right = [], 0
    for number, view in asked:
        start = time.process_time()
        right += find(view) == number
        took.append(1e3 * (time.process_time() - start))
        if len(took) == 1:
            waited_s = time.perf_counter() - clock
    again = []
    for _, view in asked:
        start = time.process_time()
        find(view)
        again.append(1e3 * (time.process_time() - start))
    status = Path("/proc/self/status").read_text().splitlines()
    memory = {line.split()[0]: int(line.split()[1]) / 1e3 for line in status if "Rss" in line[:6]}
    return {
        "open": opening, "first": took[0], "clock_s": waited_s, "others": took[1:],
        "again": again, "right": right / len(asked), "memory": memory["RssAnon:"],
    }  # fmt: skip


def drop_from_cache(folder: Path) -> None:
    """Ask the system to forget the files of a folder, as after a restart of the machine."""
    os.sync()
    for file in folder.rglob("*"):
        if file.is_file():
            handle = os.open(file, os.O_RDONLY)
            os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)
            os.close(handle)


def report(structure: str, rounds: Sequence[dict[str, Any]]) -> None:
    """Print one line of the medians of the rounds."""

    def middle(key: str) -> float:
        return float(np.median([one[key] for one in rounds]))

    others, again = (np.concatenate([one[key] for one in rounds]) for key in ("others", "again"))
    print(
        f"{structure:17s} opening {middle('open'):6.0f} ms, first {middle('first'):6.0f} ms, "
        f"on the clock {middle('clock_s'):5.2f} s; others {np.median(others):6.1f} "
        f"(95 % {np.quantile(others, 0.95):6.1f}), again {np.median(again):6.1f} "
        f"({np.quantile(again, 0.95):6.1f}) ms; right {middle('right'):.2f}; "
        f"{middle('memory'):.0f} MB not of files",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, help="folder of pictures, for their descriptors")
    parser.add_argument("--views", type=int, default=100_000)
    parser.add_argument("--descriptors", type=int, default=48, help="of a view")
    parser.add_argument("--queries", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--ask", nargs=2, metavar=("STRUCTURE", "FOLDER"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.ask:
        print(json.dumps(ask(args.ask[0], Path(args.ask[1]))))
        return
    if args.images is None:
        parser.error("--images FOLDER is needed")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make(args, folder)
        found: dict[str, list[dict[str, Any]]] = {each: [] for each in STRUCTURES}
        for _ in range(args.rounds):
            for structure in STRUCTURES:
                drop_from_cache(folder)
                command = [sys.executable, __file__, "--ask", structure, name]
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                found[structure].append(json.loads(done.stdout.splitlines()[-1]))
                report(f"  {structure}", found[structure][-1:])  # a run may be cut short
        for structure, rounds in found.items():
            report(structure, rounds)


if __name__ == "__main__":
    main()
