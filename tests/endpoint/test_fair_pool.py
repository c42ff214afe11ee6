"""Threads of which no single caller takes all."""

from __future__ import annotations

import threading
from concurrent.futures import CancelledError

import pytest

from endpoint.fair_pool import FairPool


def test_one_callers_work_leaves_threads_to_others() -> None:
    pool, gate = FairPool(3, 2, "test"), threading.Event()
    slow = [pool.submit("nao-1", gate.wait) for _ in range(6)]
    assert pool.submit("nao-2", lambda: "at once").result(60) == "at once"
    assert pool.submit(None, lambda: "nobody's").result(60) == "nobody's"
    assert not any(future.done() for future in slow)
    gate.set()
    assert all(future.result(60) for future in slow)
    assert pool.submit("nao-1", lambda: "after them").result(60) == "after them"
    pool.shutdown(wait=True)


def test_errors_and_cancelled_work_free_the_share() -> None:
    pool, gate = FairPool(2, 1, "test"), threading.Event()
    held = pool.submit("nao-1", gate.wait)
    cancelled = pool.submit("nao-1", lambda: "never")
    broken = pool.submit("nao-1", lambda: 1 // 0)
    assert cancelled.cancel()
    gate.set()
    with pytest.raises(ZeroDivisionError):
        broken.result(60)
    assert held.result(60)
    assert pool.submit("nao-1", lambda: "again").result(60) == "again"
    pool.shutdown(wait=True)


def test_what_waits_when_the_pool_closes_is_cancelled() -> None:
    pool, gate = FairPool(2, 1, "test"), threading.Event()
    held = pool.submit("nao-1", gate.wait)
    waiting = pool.submit("nao-1", lambda: "never")
    pool.shutdown(wait=False)
    gate.set()
    assert held.result(60)
    with pytest.raises(CancelledError):
        waiting.result(60)
    with pytest.raises(RuntimeError):
        pool.submit("nao-1", lambda: "closed").result(60)
