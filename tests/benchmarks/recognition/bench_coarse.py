"""The coarse stage of the index among many views: hash tables against faiss on the same codes.

    python bench_coarse.py --images FOLDER                        # 10,000 views
    python bench_coarse.py --images FOLDER --views 100000 --descriptors 64 --queries 20
    python bench_coarse.py --pooled                               # vectors of the look of views

Descriptors of objects are put together from pieces of real ones of the images, so that their codes
fill buckets as real ones do, and no two objects share any. Of each object ten views are stored; of
a query half shows the object, half something else. Every structure gets the same codes and the same
queries, one thread each; what it finds is measured exactly and votes by the ratio rule, as in the
index. *Own votes*: descriptors that vote for the right object. Removal at any time and which object
a rival belongs to are not asked of faiss.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # one thread of either side is timed

import cv2
import numpy as np
from numpy.typing import NDArray

from features.recognition.candidates import RecogniserParams
from features.recognition.index.cascade import build_tables, match_tables
from features.recognition.index.hashing import TABLE_BITS, Hasher, used_table_bits
from features.recognition.index.nearest import FAR
from features.recognition.views.appearance import APPEARANCE_SIZE

PARAMS = RecogniserParams()
VIEWS_OF_EACH = 10
NEIGHBOURS = 16
NOISE = 12.0
"""Puts the same point in two views .31 of the length apart, as between neighbouring views."""
Found = tuple[NDArray[np.integer], NDArray[np.integer], NDArray[np.integer]]


@dataclass(frozen=True)
class Stored:
    """Descriptors of all views with their codes, object by object, and the queries."""

    descriptors: NDArray[np.uint8]
    codes: NDArray[np.uint64]
    buckets: NDArray[np.uint32]
    rows_of_view: int
    asked: list[tuple[int, NDArray[np.uint8]]]
    hasher: Hasher

    @property
    def object_of_row(self) -> NDArray[np.int32]:
        """Number of the object of each row."""
        rows = np.arange(len(self.descriptors), dtype=np.int64)
        return (rows // (VIEWS_OF_EACH * self.rows_of_view)).astype(np.int32)


def cells_of(folder: Path, most: int = 70) -> NDArray[np.float32]:
    """Return descriptors of images, RootSIFT times 512, as cells (n, 16, 8)."""
    found = []
    sift = cv2.SIFT_create(600)
    files = sorted(file for file in folder.rglob("*") if file.suffix in (".jpg", ".png"))
    for file in files[:: max(1, len(files) // most)]:
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        descriptors = None if grey is None else sift.detectAndCompute(grey, None)[1]
        if descriptors is not None:
            found.append(descriptors)
    rows = np.concatenate(found)
    rows /= rows.sum(axis=1, keepdims=True) + 1e-9
    return np.minimum(np.sqrt(rows) * 512, 255).reshape(-1, 16, 8).astype(np.float32)


def drawn(cells: NDArray[np.float32], count: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return descriptors (count, 128): two neighbouring cells come from one of the given."""
    pick = rng.integers(0, len(cells), (count, 8)).repeat(2, axis=1)
    return cells[pick, np.arange(16)].reshape(count, 128)


def seen(base: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the descriptors as another view has them."""
    noise = rng.normal(0, NOISE, base.shape) * np.sqrt(np.maximum(base, 4) / 45)
    return np.clip(base + noise, 0, 255).astype(np.uint8)


def stored_views(cells: NDArray[np.float32], views: int, rows: int, queries: int) -> Stored:
    """Make objects, their views and queries."""
    objects, hasher = views // VIEWS_OF_EACH, Hasher.seeded()
    asked_of = set(np.random.default_rng(5).choice(objects, queries, replace=False).tolist())
    descriptors = np.empty((objects * VIEWS_OF_EACH * rows, 128), np.uint8)
    codes = np.empty((len(descriptors), 2), np.uint64)
    buckets = np.empty((len(descriptors), 8), np.uint32)
    asked = []
    for number in range(objects):
        rng = np.random.default_rng([7, number])
        base, start = drawn(cells, rows, rng), number * VIEWS_OF_EACH * rows
        for view in range(VIEWS_OF_EACH):
            descriptors[start + view * rows : start + (view + 1) * rows] = seen(base, rng)
        own = slice(start, start + VIEWS_OF_EACH * rows)
        codes[own], buckets[own] = hasher.encode(descriptors[own])
        if number in asked_of:
            query = seen(base, rng)
            query[: rows // 2] = drawn(cells, rows // 2, rng)
            asked.append((number, query))
    return Stored(descriptors, codes, buckets, rows, asked, hasher)


def report(
    name: str, stored: Stored, find: Callable[[NDArray[np.uint8]], Found], cost: str
) -> None:
    """Ask all queries and print time and votes."""
    took, own, right = [], [], 0
    find(stored.asked[0][1])
    for number, query in stored.asked:
        start = time.thread_time()
        labels, nearest, rival = find(query)
        took.append(1e3 * (time.thread_time() - start))
        usual = np.minimum(rival, PARAMS.usual_rival)
        votes = labels[(nearest < PARAMS.distance_cap) & (nearest < PARAMS.ratio * usual)]
        votes = votes[votes >= 0]
        own.append(np.count_nonzero(votes == number))
        right += bool(len(votes)) and int(np.bincount(votes).argmax()) == number
    middle, high = np.percentile(took, [50, 95])
    print(
        f"{name:22s} CPU median {middle:6.1f} ms, 95 % {high:6.1f} ms, right {right} of "
        f"{len(stored.asked)}, own votes {np.mean(own):.1f} of {stored.rows_of_view // 2}, {cost}",
        flush=True,
    )


def by_tables(stored: Stored, bits: int) -> tuple[Callable[[NDArray[np.uint8]], Found], str]:
    """Return cascade hashing as the index does it, with so many bits of a table."""
    start = time.process_time()
    offsets, rows = build_tables(stored.buckets, bits)
    cost = f"{time.process_time() - start:.0f} s, "
    size = offsets.nbytes + rows.nbytes + stored.codes.nbytes + stored.buckets.nbytes
    objects = stored.object_of_row
    views = (np.arange(len(objects)) // stored.rows_of_view).astype(np.int32)
    labels = np.arange(views[-1] + 1, dtype=np.int32) // VIEWS_OF_EACH
    alive = np.ones(len(objects), np.uint8)

    def find(query: NDArray[np.uint8]) -> Found:
        codes, buckets = stored.hasher.encode(query)
        best, nearest, _, rival = match_tables(
            *(query, codes, buckets, stored.descriptors, stored.codes, offsets, rows),
            *(labels, views, alive, True),
        )
        return np.where(best >= 0, objects[best], -1), nearest, rival

    return find, f"{cost}{size / 1e6:.0f} MB"


def by_faiss(stored: Stored, name: str) -> tuple[Callable[[NDArray[np.uint8]], Found], str]:
    """Return a search of faiss over the codes, what it finds measured exactly."""
    import faiss

    faiss.omp_set_num_threads(1)
    codes = stored.codes.view(np.uint8).reshape(-1, 16)
    start = time.process_time()
    kind, _, probes = name.partition(" ")
    index = faiss.IndexBinaryFlat(128)
    if kind == "BinaryIVF":
        cells = int(np.clip(len(codes) // 300, 16, 4096))
        quantiser = index
        index = faiss.IndexBinaryIVF(quantiser, 128, cells)
        index.cp.niter = 6
        index.train(codes[:: max(1, len(codes) // (40 * cells))])
        index.nprobe = int(probes)
    index.add(codes)
    cost = f"{time.process_time() - start:.0f} s, {len(codes) * 24 / 1e6:.0f} MB"
    objects = stored.object_of_row

    def find(query: NDArray[np.uint8]) -> Found:
        asked, _ = stored.hasher.encode(query)
        _, rows = index.search(asked.view(np.uint8).reshape(-1, 16), NEIGHBOURS)
        apart = stored.descriptors[rows].astype(np.int32) - query[:, None].astype(np.int32)
        distances = np.where(rows >= 0, (apart**2).sum(axis=2), FAR)
        first = distances.argmin(axis=1)[:, None]
        nearest = np.take_along_axis(distances, first, axis=1)[:, 0]
        labels = np.where(rows >= 0, objects[rows], -1)
        best = np.take_along_axis(labels, first, axis=1)
        rival = np.where(labels == best, FAR, distances).min(axis=1)
        return best[:, 0], nearest, rival

    return find, cost


def pooled(views: int) -> None:
    """Print what the most similar of so many looks take by numpy and by faiss."""
    import faiss

    faiss.omp_set_num_threads(1)
    rng = np.random.default_rng(0)
    base = rng.gamma(0.4, 1, (views // VIEWS_OF_EACH, APPEARANCE_SIZE))

    def varied(rows: NDArray[np.float64]) -> NDArray[np.float32]:
        rows = rows * rng.gamma(8, 1 / 8, rows.shape)
        return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)

    looks = varied(base.repeat(VIEWS_OF_EACH, axis=0))
    queries = varied(base[rng.choice(len(base), 20, replace=False)])
    exact = [np.argsort(-(looks @ query), kind="stable")[:5] for query in queries]
    size = APPEARANCE_SIZE
    product = faiss.METRIC_INNER_PRODUCT
    structures = {
        "faiss, flat": faiss.IndexFlatIP(size),
        "faiss, 8 bits": faiss.IndexScalarQuantizer(size, faiss.ScalarQuantizer.QT_8bit, product),
        "faiss, 16 of 256 cells": faiss.IndexIVFFlat(faiss.IndexFlatIP(size), size, 256, product),
    }
    ways: dict[str, Callable[[NDArray[np.float32]], NDArray[np.integer]]] = {
        "numpy": lambda query: np.argpartition(-(looks @ query), 5)[:5]
    }
    for name, index in structures.items():
        if not index.is_trained:
            index.train(looks[:: max(1, views // 10_000)])
        index.add(looks)
        if "cells" in name:
            index.nprobe = 16
        ways[name] = lambda query, index=index: index.search(query[None], 5)[1][0]
    for name, find in ways.items():
        took, same = [], []
        find(queries[0])
        for query, truth in zip(queries, exact, strict=True):
            start = time.thread_time()
            answer = find(query)
            took.append(1e3 * (time.thread_time() - start))
            same.append(len(set(answer.tolist()) & set(truth.tolist())) / 5)
        print(f"{views} looks, {name}: CPU median {np.median(took):.2f} ms, "
              f"of the first five {np.mean(same):.3f}", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--images", type=Path, help="folder of pictures, for their descriptors")
    parser.add_argument("--views", type=int, default=10_000)
    parser.add_argument("--descriptors", type=int, default=128, help="of a view")
    parser.add_argument("--queries", type=int, default=30)
    parser.add_argument("--probes", type=int, nargs="*", default=[4, 8, 16])
    parser.add_argument("--flat", action="store_true", help="every code compared as well")
    parser.add_argument("--pooled", action="store_true")
    args = parser.parse_args()
    if args.pooled:
        for views in (10_000, 100_000):
            pooled(views)
        return
    if args.images is None:
        parser.error("--images FOLDER or --pooled is needed")
    stored = stored_views(cells_of(args.images), args.views, args.descriptors, args.queries)
    print(f"{args.views} views, {len(stored.codes)} descriptors, load {os.getloadavg()[0]:.0f}")
    for bits in sorted({used_table_bits(len(stored.codes)), TABLE_BITS}):
        report(f"tables of {bits} bits", stored, *by_tables(stored, bits))
    names = [f"BinaryIVF {probes}" for probes in args.probes] + ["BinaryFlat"] * args.flat
    for name in names:
        report(name, stored, *by_faiss(stored, name))


if __name__ == "__main__":
    main()
