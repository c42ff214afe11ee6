"""Ten thousand stored views: query, restart, size on disk, and what faiss does with the same.

    python bench_index_scale.py                  # synthetic descriptors
    python bench_index_scale.py --cache FOLDER   # views of the YCB turntable
    python bench_index_scale.py --prints FOLDER  # cartons, families of three

The cache is the one that ``bench_recognition.py turntable --cache`` fills. Cartons are generated
and described when FOLDER does not hold them, 40 ms each; every one has siblings that share print.

Every matcher gets the same queries, the peers the first few of them, one thread each, and is judged
by the same votes: a descriptor votes for the object of its nearest neighbour when that passes the
ratio rule against the nearest of another object among the 32 nearest. Peers are made, asked and
dropped one by one; all five together need 4 GB and, on two idle cores, about eight minutes. faiss's
structures answer with numbers of descriptors only; ours also says keypoints and views and allows
removal at any time.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # one thread of either side is timed

import numpy as np
from numpy.typing import NDArray

from features.recognition import Recogniser, RecognitionIndex, ViewFeatures, warm_up
from features.recognition.candidates import RecogniserParams
from tests.benchmarks.recognition.generated_prints import described, families
from tests.benchmarks.recognition.turntable import described_views, ycb_folder, ycb_names

Stored = list[tuple[str, ViewFeatures]]
Neighbours = tuple[NDArray[np.integer], NDArray[np.floating]]
NEIGHBOURS = 32
FAMILIES = 167
COMPARED = 60
"""Stored views whose comparison is timed where not all were compared before."""
PEERS = ("Flat", "IVF", "BinaryFlat", "HNSW", "BinaryHNSW")
PARAMS = RecogniserParams()


def turntable_views(cache: Path, rng: np.random.Generator, every: int, step: int) -> Stored:
    """Return the views of every so manieth object of the YCB turntable in random order."""
    folder = ycb_folder()
    if folder is None:
        raise SystemExit("ycb not found; set RTASK_SHARED_DATA to its parent")
    names = ycb_names(folder)[::every]
    views = [(n, f) for n in names for f in described_views(folder, n, step, 0, cache)]
    return [views[k] for k in rng.permutation(len(views))]


def synthetic_views(count: int, rng: np.random.Generator) -> Stored:
    """Return ten views each of objects whose descriptors are drawn once and blurred by noise."""
    image = (rng.random((16, 16)).repeat(8, axis=0).repeat(8, axis=1) * 255).astype(np.uint8)
    from features.recognition import describe_view

    base = describe_view(image, np.ones(image.shape, bool))
    views: Stored = []
    for thing in range(-(-count // 10)):
        own = np.random.default_rng([thing, 1])
        rows = own.gamma(0.6, 40, (128, 128))
        keypoints = np.column_stack([own.uniform(0, 128, (128, 2)), np.full(128, 5), np.zeros(128)])
        for _ in range(10):
            noisy = np.clip(rows + own.normal(0, 8, rows.shape), 0, 255).astype(np.uint8)
            view = replace(
                base,
                keypoints=keypoints.astype(np.float32),
                descriptors=noisy,
                points3d=np.full((128, 3), np.nan, np.float32),
            )
            views.append((f"o:{thing}", view))
    return [views[k] for k in rng.permutation(len(views))]


def printed_views(folder: Path, stored: int, asked: int, seed: int) -> Stored:
    """Return views of cartons, as many of each, and behind them one more of some.

    The cartons come in families of three that share print (:mod:`generated_prints`).
    """
    cards = families(FAMILIES, 4000)
    views_of_each = -(-stored // len(cards))
    folder.mkdir(parents=True, exist_ok=True)

    def view(card: int, k: int) -> tuple[str, ViewFeatures]:
        file = folder / f"{card}-{k}.npz"
        if not file.exists():
            features = described(cards[card].print_, np.random.default_rng([77, card, k]))
            file.write_bytes(features.to_bytes())
        return cards[card].name, ViewFeatures.from_bytes(file.read_bytes())

    rounds = [(card, k) for k in range(1, views_of_each + 1) for card in range(len(cards))]
    order = np.random.default_rng([3, seed]).permutation(len(cards))
    asked_of = [(card, 0) for card in order[:asked].tolist()]
    return [view(*one) for one in (*rounds[:stored], *asked_of)]


def winner(
    labels: NDArray[np.integer], nearest: NDArray[np.floating], rival: NDArray[np.floating]
) -> int:
    """Return the object with most votes, -1 without any."""
    good = (nearest < PARAMS.distance_cap) & (
        nearest < PARAMS.ratio * np.minimum(rival, PARAMS.usual_rival)
    )
    voted = labels[good & (labels >= 0)]
    return int(np.bincount(voted).argmax()) if len(voted) else -1


def winner_of(found: Neighbours, label_of_row: NDArray[np.int32]) -> int:
    """Return the same from the rows and squared distances (n, k) that faiss gives."""
    rows, distances = found
    order = np.argsort(distances, axis=1, kind="stable")
    rows = np.take_along_axis(rows, order, axis=1)
    distances = np.take_along_axis(distances, order, axis=1).astype(np.float64)
    labels = np.where(rows >= 0, label_of_row[rows], -1)
    others = np.where((labels != labels[:, :1]) & (rows >= 0), distances, np.inf)
    return winner(labels[:, 0], distances[:, 0], others.min(axis=1))


@dataclass(frozen=True)
class Peer:
    """A structure of faiss over all descriptors: how it searches, and what it cost."""

    search: Callable[[ViewFeatures], Neighbours]
    built_s: float
    size_mb: float


def faiss_peer(
    name: str, full: NDArray[np.float32], encode: Callable[[NDArray], NDArray], folder: Path
) -> Peer:
    """Build one structure over descriptors (N, 128), or over the codes (N, 16) made of them."""
    import faiss

    is_binary = name.startswith("Binary")
    rows = encode(full.astype(np.uint8)) if is_binary else full
    faiss.omp_set_num_threads(os.cpu_count())
    start = time.perf_counter()
    if name == "BinaryHNSW":
        index = faiss.IndexBinaryHNSW(128, 16)
    elif is_binary:
        index = faiss.IndexBinaryFlat(128)
    elif name == "HNSW":
        index = faiss.IndexHNSWFlat(128, 16)
        index.hnsw.efSearch = 64
    elif name == "Flat":
        index = faiss.IndexFlatL2(128)
    else:
        cells = int(np.clip(len(full) // 256, 16, 1024))
        index = faiss.IndexIVFFlat(faiss.IndexFlatL2(128), 128, cells)
        index.train(full[:: max(1, len(full) // 50_000)])
        index.nprobe = 8
    index.add(rows)
    built = time.perf_counter() - start
    faiss.omp_set_num_threads(1)
    file = folder / f"{name}.faiss"
    (faiss.write_index_binary if is_binary else faiss.write_index)(index, str(file))
    size = file.stat().st_size / 1e6
    file.unlink()

    def search(view: ViewFeatures) -> Neighbours:
        query = view.descriptors.astype(np.float32)
        if not is_binary:
            distances, rows = index.search(query, NEIGHBOURS)
            return rows, distances
        _, rows = index.search(encode(view.descriptors), NEIGHBOURS)
        return rows, ((full[rows] - query[:, None]) ** 2).sum(axis=2)

    return Peer(search, built, size)


def timed(step: Callable[[], int]) -> tuple[int, float, float]:
    """Return the answer, the clock and the thread's processor time in ms."""
    wall, cpu = time.perf_counter(), time.thread_time()
    answer = step()
    return answer, 1e3 * (time.perf_counter() - wall), 1e3 * (time.thread_time() - cpu)


def folder_size(folder: Path) -> float:
    """Return the megabytes of all files."""
    return sum(p.stat().st_size for p in folder.rglob("*") if p.is_file()) / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=10_000)
    parser.add_argument("--queries", type=int, default=40)
    parser.add_argument("--cache", type=Path, help="described views of the turntable")
    parser.add_argument("--prints", type=Path, help="generated cartons, described ones kept here")
    parser.add_argument("--every", type=int, default=1, help="cache: every so many objects")
    parser.add_argument("--step", type=int, default=5, help="cache: degrees between views")
    parser.add_argument("--peers", default=",".join(PEERS), help="structures of faiss, or none")
    parser.add_argument("--peer-queries", type=int, default=10)
    parser.add_argument(
        "--prepared",
        action="store_true",
        help="compare the stored views with each other first, as the server does",
    )
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    peers = [name for name in PEERS if name in args.peers.split(",")]
    rng = np.random.default_rng(args.seed)
    total = args.views + args.queries
    if args.cache:
        views = turntable_views(args.cache, rng, args.every, args.step)
    elif args.prints:
        views = printed_views(args.prints, args.views, args.queries, args.seed)
    else:
        views = synthetic_views(total, rng)
    stored, asked = views[: args.views], views[args.views : total]
    warm_up()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "index"
        described = ((f"v:{k}", o, "class:x", f.to_bytes()) for k, (o, f) in enumerate(stored))
        start, cpu = time.perf_counter(), time.process_time()
        RecognitionIndex.rebuild(path, described).close()
        print(
            f"{len(stored)} views, {sum(len(f) for _, f in stored)} descriptors: made in "
            f"{time.perf_counter() - start:.0f} s ({time.process_time() - cpu:.0f} s CPU), "
            f"{folder_size(path):.0f} MB on disk, load {os.getloadavg()[0]:.0f}"
        )
        if args.prepared:
            prepare(path)
        for turn in ("first", "second"):
            start, cpu = time.perf_counter(), time.process_time()
            with RecognitionIndex(path) as index:
                Recogniser(index).recognise(asked[0][1])
                print(
                    f"open and first answer, {turn} time: {time.perf_counter() - start:.2f} s, "
                    f"{time.process_time() - cpu:.2f} s CPU"
                )
        index = RecognitionIndex(path)
        ask_ours(index, asked, args.peer_queries)
        index.close()
        with RecognitionIndex(path) as again:
            ask_again(again, asked)
        with RecognitionIndex(path) as growing:
            ask_while_growing(growing, asked)
        ask_peers(index, stored, asked[: args.peer_queries], peers, Path(folder))


def prepare(path: Path) -> None:
    """Compare all stored views in portions, as the server does, and print what it takes."""
    cpu, before = time.process_time(), folder_size(path)
    with RecognitionIndex(path) as index:
        recogniser = Recogniser(index)
        while recogniser.compare_outdated(64):
            pass
        took = 1e3 * (time.process_time() - cpu) / max(len(index), 1)
    print(f"compared: {took:.0f} ms CPU a view, {folder_size(path) - before:.0f} MB more on disk")


def ask_ours(index: RecognitionIndex, asked: Stored, few: int) -> None:
    """Print what the whole answer and the matching alone take; the latter also for the first few.

    The peers are asked the first few only.
    """
    snapshot, recogniser = index.snapshot(), Recogniser(index)
    numbers = {name: k for k, name in enumerate(snapshot.object_iris)}

    def cascade(view: ViewFeatures) -> int:
        found = snapshot.match(view.descriptors)
        labels = np.where(found.view >= 0, snapshot.object_of_view[found.view], -1)
        return winner(labels, found.nearest, found.rival)

    def recognised(view: ViewFeatures) -> int:
        matches = recogniser.recognise(view).matches
        return numbers[matches[0].object_iri] if matches else -1

    truth = np.array([numbers.get(name, -2) for name, _ in asked])
    print(f"{len(asked)} queries, {np.mean([len(f) for _, f in asked]):.0f} descriptors each")
    report("whole answer", [timed(lambda v=view: recognised(v)) for _, view in asked], truth)
    answers = [timed(lambda v=view: cascade(v)) for _, view in asked]
    report("cascade hashing", answers, truth)
    report(f"  the first {few}", answers[:few], truth[:few])


def ask_again(index: RecognitionIndex, asked: Stored) -> None:
    """Print what the same queries take after a start, and what comparing stored views takes."""
    recogniser = Recogniser(index)
    for turn in ("after a start", "and asked again"):
        took = [timed(lambda v=view: len(recogniser.recognise(v).matches))[2] for _, view in asked]
        middle, high = np.percentile(took, [50, 95])
        print(f"{turn:18s} CPU median {middle:7.1f} ms, 95 % {high:7.1f} ms")
    left = recogniser.compare_outdated(0)
    cpu = time.process_time()
    recogniser.compare_outdated(COMPARED)
    took_ms = 1e3 * (time.process_time() - cpu) / max(min(left, COMPARED), 1)
    status = Path("/proc/self/status").read_text()
    resident = {line.split()[0]: int(line.split()[1]) / 1e3 for line in status.splitlines()
                if line.startswith(("VmRSS", "RssAnon"))}  # fmt: skip
    print(f"{left} views outdated, {took_ms:.0f} ms CPU a view to compare {min(left, COMPARED)}")
    print(f"memory {resident['VmRSS:']:.0f} MB, of which {resident['RssAnon:']:.0f} not of files")


def ask_while_growing(index: RecognitionIndex, asked: Stored) -> None:
    """Print what an insertion costs itself, and the queries of others after it.

    The first half is asked over and over; of the second half one view is stored in between.
    """
    queries, arriving = asked[: len(asked) // 2], asked[len(asked) // 2 :]
    recogniser, took = Recogniser(index), []

    def ask(view: ViewFeatures) -> float:
        return timed(lambda: len(recogniser.recognise(view).matches))[2]

    for _, view in queries:
        ask(view)
    for k, (name, view) in enumerate(arriving):
        query = queries[k % len(queries)][1]
        ask(query)
        before = ask(query)
        added = timed(lambda k=k, n=name, v=view: index.add(f"new:{k}", n, "class:x", v) or 0)[2]
        compared = timed(lambda k=k: recogniser.prepare([f"new:{k}"]) or 0)[2]
        twins = timed(lambda k=k: len(recogniser.same_print(f"new:{k}")))[2]
        took.append((before, compared, twins, added + compared + twins, ask(query)))
    middle, high = np.percentile(took, [50, 95], axis=0)
    names = ("asked again", "new view compared", "twins looked for", "insertion", "asked after it")
    for name, m, h in zip(names, middle, high, strict=True):
        print(f"{name:18s} CPU median {m:7.1f} ms, 95 % {h:7.1f} ms")


def ask_peers(
    index: RecognitionIndex, stored: Stored, asked: Stored, peers: list[str], folder: Path
) -> None:
    """Make one structure after the other, ask it, and drop it."""
    snapshot = index.snapshot()
    numbers = {name: k for k, name in enumerate(snapshot.object_iris)}
    full = np.concatenate([f.descriptors for _, f in stored]).astype(np.float32)
    label_of_row = np.repeat([numbers[o] for o, _ in stored], [len(f) for _, f in stored])
    truth = np.array([numbers.get(name, -2) for name, _ in asked])

    def encode(descriptors: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return snapshot.hasher.encode(descriptors)[0].view(np.uint8).reshape(-1, 16)

    for name in peers:
        peer = faiss_peer(name, full, encode, folder)
        answers = [
            timed(lambda v=view, p=peer: winner_of(p.search(v), label_of_row)) for _, view in asked
        ]
        report(name, answers, truth, f", built in {peer.built_s:.0f} s, {peer.size_mb:.0f} MB")


def report(
    name: str,
    answers: list[tuple[int, float, float]],
    truth: NDArray[np.integer],
    extra: str = "",
) -> None:
    """Print one line."""
    found, wall, cpu = (np.array(column) for column in zip(*answers, strict=True))
    print(
        f"{name:16s} right {np.mean(found == truth):.3f}, CPU median {np.median(cpu):7.1f} ms, "
        f"95 % {np.percentile(cpu, 95):7.1f} ms, clock {np.median(wall):7.1f} ms{extra}",
        flush=True,
    )


if __name__ == "__main__":
    main()
