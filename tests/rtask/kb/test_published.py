"""Reading beside a writer in another process: the newest snapshot that it has published."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import rtask
from rtask.errors import StoreError, StoreLockedError
from rtask.kb.durability.published import hold_newest

WRITER = """
import sys, rtask
kb = rtask.open(sys.argv[1], ontologies=False, flush="os")
print("open", flush=True)
for line in sys.stdin:
    word, _, rest = line.strip().partition(" ")
    if word == "add":
        for n in range(int(rest)):
            kb.update(f"INSERT DATA {{ <urn:{kb.seq}:{n}> <urn:p> {n} }}")
    elif word == "checkpoint":
        kb.checkpoint()
    elif word == "kill":
        import os, signal
        os.kill(os.getpid(), signal.SIGKILL)
    print(kb.seq, flush=True)
kb.close()
"""
COUNT = "SELECT (COUNT(*) AS ?n) { ?s <urn:p> ?o }"


class Writer:
    """A process that has a folder open for writing."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._line() == "open"

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def say(self, order: str) -> int:
        """Give an order; return the number of the last commit."""
        assert self.process.stdin is not None
        self.process.stdin.write(order + "\n")
        self.process.stdin.flush()
        return int(self._line() or -1)

    def end(self) -> None:
        """End the process, closing the folder."""
        self.process.communicate(timeout=60)


@contextmanager
def writing(folder: Path) -> Iterator[Writer]:
    writer = Writer(folder)
    try:
        yield writer
    finally:
        writer.end()


def _count(kb: rtask.KnowledgeBase) -> object:
    (row,) = kb.select(COUNT)
    return row.value("n")


@pytest.mark.slow
def test_a_reader_beside_a_writer_sees_its_newest_snapshot(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    with writing(folder) as writer:
        before = writer.say("add 5")
        with rtask.open(folder, mode="r") as early:
            assert _count(early) == 0  # published when the folder was opened
            writer.say("checkpoint")
            with rtask.open(folder, mode="r") as kb:
                assert (_count(kb), kb.seq) == (5, before)
                (row,) = kb.select(COUNT, timeout_s=60.0)
                assert row.value("n") == 5
                writer.say("add 3")
                writer.say("checkpoint")
                writer.say("add 1")
                writer.say("checkpoint")
                assert _count(kb) == 5  # what it opened stays as it was
                with rtask.open(folder, mode="r") as later:
                    assert _count(later) == 9
            assert _count(early) == 0
        with pytest.raises(StoreLockedError):
            rtask.open(folder)
    assert not (folder / "published").exists()
    with rtask.open(folder, mode="r") as kb:
        assert _count(kb) == 9


@pytest.mark.slow
def test_a_snapshot_is_kept_as_long_as_somebody_reads_it(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    with writing(folder) as writer:
        writer.say("add 1")
        writer.say("checkpoint")
        held = hold_newest(folder)
        assert held is not None
        for _ in range(3):
            writer.say("add 1")
            writer.say("checkpoint")
        assert held.path.exists()
        assert len(list((folder / "published").iterdir())) == 2
        held.release()
        writer.say("add 1")
        writer.say("checkpoint")
        assert not held.path.exists()
        assert len(list((folder / "published").iterdir())) == 1


@pytest.mark.slow
def test_after_a_killed_writer_a_folder_is_recovered_as_before(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    writer = Writer(folder)
    writer.say("add 4")
    writer.say("kill")
    writer.end()
    with pytest.raises(StoreError, match="not closed properly"):
        rtask.open(folder, mode="r")
    with rtask.open(folder, ontologies=False) as kb:
        assert _count(kb) == 4
    assert not (folder / "published").exists()


@pytest.mark.slow
def test_readers_open_and_close_while_the_writer_works(tmp_path: Path) -> None:
    """Opening at random moments between checkpoints never fails, and never goes back."""
    folder = tmp_path / "kb"
    seen = 0
    with writing(folder) as writer:
        for step in range(12):
            writer.say("add 2")
            if step % 2:
                writer.say("checkpoint")
            with rtask.open(folder, mode="r") as kb:
                found = _count(kb)
                assert isinstance(found, int)
                assert seen <= found <= 2 * (step + 1)
                seen = found
    assert seen == 24
