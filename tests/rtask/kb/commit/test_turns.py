"""Who writes next: small changes before large ones that wait."""

from __future__ import annotations

import threading

import pytest

import rtask
from rtask.errors import UsageError
from rtask.kb.store.commit_writes import MAX_LATE
from rtask.knowledge_base import KnowledgeBase

LARGE = MAX_LATE + 1


def test_a_small_change_waits_for_one_of_many_large_ones() -> None:
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        order: list[str] = []
        threads = [threading.Thread(target=change, args=(kb, f"large {n}", LARGE, order))
                   for n in range(4)]  # fmt: skip
        first = kb.writer.begin(LARGE)
        for thread in threads:
            thread.start()
        while kb.writer.queue()[0] < len(threads):
            pass
        small = threading.Thread(target=change, args=(kb, "small", 1, order))
        small.start()
        while kb.writer.queue()[0] <= len(threads):
            pass
        assert first.is_empty()
        kb.writer.cancel()
        for thread in (*threads, small):
            thread.join(60)
    assert (order[0], len(order)) == ("small", 5)


def change(kb: KnowledgeBase, name: str, size: int, order: list[str]) -> None:
    """Hold the lock for a moment."""
    kb.writer.begin(size)
    order.append(name)
    kb.writer.cancel()


def test_a_large_change_inside_a_transaction_is_refused_and_leaves_the_lock_free() -> None:
    with rtask.open(":memory:", ontologies=False, reason=False) as kb:
        for outer in (0, LARGE):
            kb.writer.begin(outer)
            with pytest.raises(UsageError, match="inside a transaction"):
                kb.writer.begin(LARGE)
            kb.writer.cancel()
        other = threading.Thread(target=change, args=(kb, "other", LARGE, []))
        other.start()
        other.join(60)
        assert not other.is_alive()
