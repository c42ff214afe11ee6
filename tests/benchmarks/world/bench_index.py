"""The index of placements at sizes that take long to write, and a stay of many placements.

python tests/benchmarks/world/bench_index.py --placements 100000 1000000 --stay 10000

The index is filled directly, and what it names is made instead of read from a store, whose look-ups
`bench_world.py` measures with it. The stay is written to a graph: one thing that is nudged about in
one box. Times are of the processor, of one thread.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from bench_world import BASE, FRAME, STAY_S, fill, percentiles_ms

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from rtask.world.index.cache import PlacementCache
from rtask.world.index.tail import Entry
from rtask.world.placement import Placement
from rtask.world.statements import ended, placed
from rtask.world.tracing import stays_of

THINGS = 300
_BOX, _CUP = f"{BASE}box", f"{BASE}cup/1"
_NUDGED_S = 60.0


def memory_mb() -> float:
    """Return the resident memory of this process, MB."""
    text = Path("/proc/self/status").read_text("ascii")
    return int(text.split("VmRSS:")[1].split()[0]) / 1e3


def placement(number: int, count: int) -> Placement:
    """Return one of the places of things that are moved in turn."""
    thing, turn = number % THINGS, number // THINGS
    begin, is_last = thing + STAY_S * turn, number + THINGS >= count
    pose = np.eye(4)
    pose[:2, 3] = np.random.default_rng(number).uniform(-5.0, 5.0, 2)
    return Placement(
        f"{BASE}placement/{number}", f"{BASE}thing/{thing}", begin,
        None if is_last else begin + STAY_S, begin + STAY_S / 2, "at", "", FRAME, pose, 0.005,
    )  # fmt: skip


def filled(kb: KnowledgeBase, count: int) -> None:
    """Fill the index of a graph with so many placements, and let them be made when read."""
    index = kb.world.index
    index._clear()
    frame = index._frame_for(f"{BASE}thing/0", FRAME)
    spots = np.random.default_rng(1).uniform(-5.0, 5.0, (count, 2)).tolist()
    entries = []
    for number, (x, y) in enumerate(spots):
        thing, turn = number % THINGS, number // THINGS
        begin = thing + STAY_S * turn
        end = np.inf if number + THINGS >= count else begin + STAY_S
        subject = index._number(f"{BASE}thing/{thing}")
        entries.append(Entry(subject, begin, f"{BASE}placement/{number}", end, frame, x, y, 0.0))
    index._sort(entries)
    index._is_filled, index._bulk_loads = True, kb.bulk_loads
    PlacementCache.read = lambda _, node: placement(int(node.rpartition("/")[2]), count)  # type: ignore[method-assign]


def ask(count: int) -> None:
    """Print a row for so many placements."""
    with rtask.open(":memory:", base=BASE, reason=False) as kb:
        fill(kb, THINGS, THINGS)
        before_mb, start = memory_mb(), time.process_time()
        read = PlacementCache.read
        try:
            filled(kb, count)
            filled_s, last_s = time.process_time() - start, STAY_S * (count // THINGS)
            where = percentiles_ms(
                lambda k, at: kb.world.where_is(f"{BASE}thing/{k}", at=at).is_known, last_s, THINGS
            )
            start = time.process_time()
            for _ in range(20):
                kb.world.index.events_near("urn:stood", FRAME, np.zeros(3), (0.0, last_s), 0.2)
            near_ms = 1e3 * (time.process_time() - start) / 20
        finally:
            PlacementCache.read = read  # type: ignore[method-assign]
        print(f"{count}\t{filled_s:.1f}\t{memory_mb() - before_mb:.0f}\t"
              f"{where[0]:.2f}\t{where[1]:.2f}\t{near_ms:.2f}", flush=True)  # fmt: skip


def stay(count: int) -> None:
    """Print how long questions about one long stay take."""
    with rtask.open(":memory:", base=BASE, reason=False) as kb:
        kb.update(
            f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ <{FRAME}> a rt:Frame . "
            f"<{_BOX}> a rt:SupportSurface ; rt:name 'box' . <{BASE}object/1> a rt:Mug ; "
            f"rt:objectId '1' . <{_CUP}> a rt:Exemplar ; rt:exemplarOf <{BASE}object/1> }} }}"
        )
        rng = np.random.default_rng(0)
        for first in range(0, count, 1_000):
            with kb.transaction("nao-1") as tx:
                for number in range(first, min(first + 1_000, count)):
                    pose, begin = np.eye(4), _NUDGED_S * number
                    pose[:2, 3] = rng.uniform(-0.2, 0.2, 2)
                    node = f"{BASE}placement/{number}"
                    made = Placement(node, _CUP, begin, None, begin, "in", _BOX, FRAME, pose, 0.005)
                    last = number + 1 == count
                    for statement in (*placed(made), *(() if last else ended(node, begin + 60.0))):
                        tx.add(*statement)
            kb.world.index.at(_CUP, 0.0)
        now_s = _NUDGED_S * count
        for name, question in (
            ("where_is at the end", lambda: kb.world.where_is(_CUP, at=now_s)),
            ("where_is in the middle", lambda: kb.world.where_is(_CUP, at=now_s / 2)),
            ("the last 100 places", lambda: stays_of(kb.world, _CUP, now_s, 100)),
        ):
            took = []
            for _ in range(5):
                start = time.process_time()
                question()
                took.append(1e3 * (time.process_time() - start))
            print(f"{name}\t{np.median(took):.2f} ms\tat most {max(took):.2f} ms", flush=True)


def main() -> None:
    """Print a row for each number of placements, and one for each question about a stay."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--placements", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--stay", type=int, default=10_000)
    asked = parser.parse_args()
    print("placements\tfilled_s\tmemory_mb\twhere_is_p50_ms\twhere_is_p95_ms\tevents_near_ms")
    for count in asked.placements:
        ask(count)
    print(f"\n{asked.stay} placements of one thing in one box")
    stay(asked.stay)


if __name__ == "__main__":
    main()
