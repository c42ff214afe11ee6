"""Processor time for which hostile writes hold the writers' lock, in one process without HTTP.

``python -m tests.benchmarks.kb.bench_lock_held [SIZE]`` stores each kind of hostile write, with the
statements that it is made of, and removes it again. Others wait while the lock is held; unlike the
time that they wait, its processor time hardly depends on what else the machine does.
"""

from __future__ import annotations

import os
import random
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import rtask
from rtask.errors import RtaskError
from rtask.kb.commit.access import Access
from rtask.kb.commit.writer import Writer
from rtask.kb.store.overlay import Overlay
from rtask.knowledge_base import KnowledgeBase
from tests.hostile_writes import KINDS, hostile_write

_ROBOT = Access("nao-1", "robot", frozenset(("schema",)))
_SEED = 33


@contextmanager
def holds() -> Iterator[list[float]]:
    """Collect the processor time in ms of each hold of a writers' lock by a change."""
    begin, cancel = Writer.begin, Writer.cancel
    times: list[float] = []
    since = [0.0]

    def timed_begin(writer: Writer) -> Overlay:
        overlay = begin(writer)
        since[0] = time.thread_time()
        return overlay

    def timed_cancel(writer: Writer) -> None:
        times.append(1e3 * (time.thread_time() - since[0]))
        cancel(writer)

    Writer.begin, Writer.cancel = timed_begin, timed_cancel  # type: ignore[method-assign]
    try:
        yield times
    finally:
        Writer.begin, Writer.cancel = begin, cancel  # type: ignore[method-assign]


def attempt(kb: KnowledgeBase, text: str) -> str:
    """Write and return how that ended."""
    try:
        done = kb.update(text, access=_ROBOT)
    except RtaskError as refused:
        return str(refused.status)
    return f"+{done.added} -{done.removed}, derived +{done.derived} -{done.withdrawn}"


def main() -> None:
    """Measure and print."""
    size = int(sys.argv[1]) if len(sys.argv) > 1 else 1_500
    print(f"up to {size} statements of a kind; load {os.getloadavg()[0]:.1f}")
    print(f"{'kind':22} longest hold (ms): insert, delete")
    with rtask.open(":memory:") as kb, holds() as times:
        kb.update("INSERT DATA { <urn:a> a <urn:B> }")
        for kind in KINDS:
            text, longest, ends = hostile_write(kind, random.Random(_SEED), size), [], []
            for verb in ("INSERT", "DELETE"):
                times.clear()
                ends.append(attempt(kb, text.replace("INSERT", verb, 1)))
                longest.append(max(times))
            shown = "; ".join(ends) if ends[0][0] == "+" else ends[0]
            print(f"{kind:22} {longest[0]:6.0f} {longest[1]:6.0f}   {shown}")


if __name__ == "__main__":
    main()
