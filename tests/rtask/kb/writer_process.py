"""Processes that write to a knowledge base until they are killed.

Run as ``python writer_process.py``. Each line on standard input is a JSON order::

    {"folder": ..., "work": "commits", "acks": ..., "at": "time", "seconds": 0.1}
    {"folder": ..., "work": "backup", "acks": ..., "at": "call", "calls": 57}

A child is forked for each, which opens the folder, works, and appends a line to ``acks`` for all
that it was told to be stored. It is killed with SIGKILL when it has computed for ``seconds`` since
its start or its first acknowledgement (``"at": "ack"``), or right before or behind the n-th
operation on a file or the store. The answer is one line, when it is dead.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rtask
from rtask.kb.commit.commit import Request
from rtask.kb.store.embedded import EmbeddedStore
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import Quad, iri, literal

REPEATS = 2_000
BULK = 300
_PATIENCE_S = 60.0
_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type"


class Writer:
    """Does one kind of work and acknowledges what was stored."""

    def __init__(self, folder: Path, acks: Path) -> None:
        self.folder = folder
        self._acks = os.open(acks, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self._counting = threading.Lock()
        self.kb: KnowledgeBase
        self.last: int

    def run(self, work: str) -> None:
        """Work until killed."""
        with rtask.open(self.folder, ontologies=False) as kb:
            self.kb, self.last = kb, _last(kb)
            self.acknowledge("open", kb.seq)
            getattr(self, work)()

    def acknowledge(self, kind: str, number: int) -> None:
        """Say that something is stored."""
        os.write(self._acks, f"{kind} {number}\n".encode())

    def outcome(self) -> None:
        """Store one outcome: a blob, and statements that stand or fall with it."""
        with self.kb.transaction(agent="nao-1") as tx:
            self.last += 1
            number = self.last
            outcome = f"urn:outcome:{number}"
            image = tx.blob(b"image %d " % number * REPEATS, "image/png")
            tx.add(outcome, _TYPE, iri("urn:Outcome"))
            tx.add(outcome, "urn:number", number)
            tx.add(outcome, "urn:image", image)
            if number > 1:
                tx.remove("urn:last", "urn:is", number - 1)
            tx.add("urn:last", "urn:is", number)
        self.acknowledge("outcome", number)

    def commits(self) -> None:
        """One outcome after the other."""
        while True:
            self.outcome()

    def group(self) -> None:
        """Eight threads whose commits share the journal's fsyncs."""
        for _ in range(8):
            threading.Thread(target=self.commits, daemon=True).start()
        threading.Event().wait()

    def checkpoint(self) -> None:
        """Outcomes, and a checkpoint behind each."""
        while True:
            self.outcome()
            self.kb.checkpoint()

    def bulk(self) -> None:
        """Large loads and outcomes in turn."""
        while True:
            self.outcome()
            number = self.last
            graph = iri(f"urn:bulk:{number}")
            quads = (
                Quad(iri(f"urn:bulk:{number}:{n}"), iri("urn:bulk"), literal(n), graph)
                for n in range(BULK)
            )
            self.kb.bulk_add(quads, graph, Request(self.kb.access(), note="bulk"))
            self.acknowledge("bulk", number)

    def backup(self) -> None:
        """Copies beside a thread that writes."""
        threading.Thread(target=self.commits, daemon=True).start()
        while True:
            before = self.kb.seq
            target = self.folder.parent / f"backup-{os.getpid()}-{before}"
            if target.exists():
                time.sleep(0.001)
                continue
            self.kb.backup(target)
            self.acknowledge("backup", before)


def _last(kb: KnowledgeBase) -> int:
    numbers = [int(quad.object.value) for quad in kb.match("urn:last", "urn:is")]  # type: ignore[union-attr]
    return max(numbers, default=0)


def die_at(call: int) -> None:
    """Kill this process before (even) or behind (odd) a certain operation on a file or store."""
    lock, done = threading.Lock(), 0

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*args: Any, **options: Any) -> Any:
            nonlocal done
            with lock:
                done += 1
                mine = done
            if mine == call // 2 and call % 2 == 0:
                os.kill(os.getpid(), signal.SIGKILL)
            try:
                return function(*args, **options)
            finally:
                if mine == call // 2 and call % 2 == 1:
                    os.kill(os.getpid(), signal.SIGKILL)

        return counted

    for owner, names in (
        (os, "write fsync fdatasync ftruncate replace unlink link mkdir open"),
        (EmbeddedStore, "extend update flush close"),
    ):
        for name in names.split():
            setattr(owner, name, watched(getattr(owner, name)))


def _obey(order: dict[str, Any]) -> None:
    acks = Path(order["acks"])
    size = _size(acks)
    child = os.fork()
    if child == 0:
        try:
            writer = Writer(Path(order["folder"]), acks)
            if order["at"] == "call":
                die_at(int(order["calls"]))
            writer.run(order["work"])
        finally:
            os._exit(1)
    ends = time.monotonic() + _PATIENCE_S
    until, started = float(order.get("seconds", 0.0)), _computed_s(child)
    awaits_ack = order["at"] == "ack"
    while os.waitpid(child, os.WNOHANG) == (0, 0):
        if awaits_ack and _size(acks) > size:
            awaits_ack, started = False, _computed_s(child)
        is_due = order["at"] != "call" and not awaits_ack
        if (is_due and _computed_s(child) - started >= until) or time.monotonic() > ends:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return
        time.sleep(0.0005)


def _computed_s(process: int) -> float:
    """Return how long a process has computed: on a busy machine it does little in a second.

    Linux numbers the clock of each process after its id (clock_getcpuclockid); elsewhere this is
    the wall's time.
    """
    try:
        return time.clock_gettime((~process << 3) | 2)
    except OSError:
        return time.monotonic()


def _size(file: Path) -> int:
    return file.stat().st_size if file.exists() else 0


def main() -> None:
    """Take orders until the input ends; what a first commit imports is imported once."""
    with rtask.open(":memory:", ontologies=False) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    for line in sys.stdin:
        _obey(json.loads(line))
        print("done", flush=True)  # noqa: T201 - this is its report


if __name__ == "__main__":
    main()
