"""Any thing at any instant, by growth: how long `where_is` takes over so many places in time.

python tests/benchmarks/world/bench_world.py --sightings 10000 100000

Times are of the processor, of one thread, in memory. Placements are written in commits of a
thousand, without the reasoner: what is measured is reading, and the index following commits.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator

import numpy as np

import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import iri
from rtask.world.placement import Placement
from rtask.world.statements import placed

BASE = "https://example.org/lab/"
FRAME = f"{BASE}frame/map"
STAY_S = 600.0
_BLOCK = 1_000


def placements(count: int, things: int, rng: np.random.Generator) -> Iterator[Placement]:
    """Yield places of things that are moved in turn, each with an end but the last of each."""
    for number in range(count):
        thing, turn = number % things, number // things
        begin = thing + STAY_S * turn
        is_last = number + things >= count
        pose = np.eye(4)
        pose[:2, 3] = rng.uniform(-5.0, 5.0, 2)
        yield Placement(
            f"{BASE}placement/{number}", f"{BASE}thing/{thing}", begin,
            None if is_last else begin + STAY_S, begin + STAY_S / 2, "at", "", FRAME, pose, 0.005,
        )  # fmt: skip


def fill(kb: KnowledgeBase, count: int, things: int) -> float:
    """Write so many placements; return the processor's time, s."""
    from rtask.world.statements import confirmed, ended

    kb.update(
        f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ <{FRAME}> a rt:Frame . "
        + " ".join(
            f'<{BASE}object/{k}> a rt:Mug ; rt:objectId "{k}" ; rt:name "cup {k}" . '
            f"<{BASE}thing/{k}> a rt:Exemplar ; rt:exemplarOf <{BASE}object/{k}> ."
            for k in range(things)
        )
        + "} }"
    )
    start, made = time.process_time(), placements(count, things, np.random.default_rng(1))
    for first in range(0, count, _BLOCK):
        with kb.transaction("nao-1") as tx:
            for _, placement in zip(range(min(_BLOCK, count - first)), made, strict=False):
                statements = [*placed(placement), confirmed(placement.iri, placement.confirmed)]
                if placement.end is not None:
                    statements += ended(placement.iri, placement.end)
                for statement in statements:
                    tx.add(*statement)
        kb.world.index.at(f"{BASE}thing/0", 0.0)  # the index follows each commit
    return time.process_time() - start


def percentiles_ms(ask: Callable[[int, float], object], last_s: float, things: int) -> list[float]:
    """Return the 50th and 95th percentile of 1,000 questions at random instants, ms."""
    rng, took = np.random.default_rng(2), []
    for _ in range(1_000):
        thing, at = int(rng.integers(things)), float(rng.uniform(STAY_S, last_s))
        start = time.process_time()
        assert ask(thing, at)
        took.append(1e3 * (time.process_time() - start))
    return [float(value) for value in np.percentile(took, [50, 95])]


def main() -> None:
    """Print a row for each number of sightings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sightings", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--things", type=int, default=300)
    asked = parser.parse_args()
    print("sightings\tfilled_s\tplaced_p50_ms\tplaced_p95_ms\twhere_is_p50_ms\twhere_is_p95_ms")
    for count in asked.sightings:
        with rtask.open(":memory:", base=BASE, reason=False) as kb:
            filled_s = fill(kb, count, asked.things)
            last_s = STAY_S * (count // asked.things)
            assert kb.match(iri(f"{BASE}thing/0"))
            figures = [
                *percentiles_ms(
                    lambda k, at: kb.world.placement_at(f"{BASE}thing/{k}", at),
                    last_s, asked.things,
                ),
                *percentiles_ms(
                    lambda k, at: kb.world.where_is(f"{BASE}thing/{k}", at=at).is_known,
                    last_s, asked.things,
                ),
            ]  # fmt: skip
            row = "\t".join(f"{figure:.3f}" for figure in figures)
            print(f"{count}\t{filled_s:.1f}\t{row}", flush=True)


if __name__ == "__main__":
    main()
