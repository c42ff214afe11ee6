"""Reading beside a writer in another process: the newest snapshot that it has published."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import rtask
from rtask.errors import ClosedError, StoreError, StoreLockedError
from rtask.kb.durability import recovery
from rtask.kb.durability.journal import encode
from rtask.kb.durability.published import hold_newest
from rtask.kb.store import replacement
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.writes import Writes
from tests.commands import run_program, start_command

WRITER = """
import sys, rtask
RDFS = "http://www.w3.org/2000/01/rdf-schema#"
RT = "https://w3id.org/rtask-kg/ns#"
kb = rtask.open(sys.argv[1], ontologies=False, flush="os")
print("open", flush=True)
for line in sys.stdin:
    word, _, rest = line.strip().partition(" ")
    if word == "add":
        for n in range(int(rest)):
            kb.update(f"INSERT DATA {{ <urn:{kb.seq}:{n}> <urn:p> {n} }}")
    elif word == "name":
        kb.update(f"INSERT DATA {{ <urn:{rest}> <{RDFS}label> '{rest}' }}")
    elif word == "place":
        at = "".join(f"; <{RT}{axis}> 0e0 " for axis in "xyz")
        kb.update(f"INSERT DATA {{ <urn:{rest}> <{RT}inFrame> <urn:table> {at} }}")
    elif word == "bulk":
        from rtask.loader import bulk, load
        load.MAX_QUADS = 20
        kb.load(rest, graph="urn:big")
    elif word == "drop":
        kb.update("DROP GRAPH <urn:big>")
    elif word == "fill":
        triples = (f"<urn:f{n}> <urn:q> {n}" for n in range(int(rest)))
        kb.update(f"INSERT DATA {{ GRAPH <urn:filled> {{ {' . '.join(triples)} }} }}")
    elif word == "empty":
        kb.update("DROP GRAPH <urn:filled>")
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
        self.process = start_command(
            WRITER,
            str(folder),
            module="tests.program",
            stdin=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )  # fmt: skip
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
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        with contextlib.suppress(BrokenPipeError):  # it was killed
            self.process.stdin.close()
        self.process.wait(60)
        self.process.stdout.close()


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
def test_a_reader_beside_a_writer_sees_each_commit(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    with writing(folder) as writer:
        before = writer.say("add 5")
        with rtask.open(folder, mode="r") as kb:
            assert (_count(kb), kb.seq) == (5, before)
            for more in range(1, 4):
                after = writer.say("add 1")
                assert (_count(kb), kb.seq) == (5 + more, after)
                (row,) = kb.select(COUNT, timeout_s=60.0)  # in a reader process of its own
                assert row.value("n") == 5 + more
            writer.say("checkpoint")
            writer.say("add 2")
            assert len(kb.match(None, "urn:p")) == 10
            assert kb.catalogue.triple_count(kb.graphs.shared) == 10
            assert [entry.seq for entry in kb.history(predicate="urn:p")][-1] == kb.seq
            assert [finding for finding in kb.verify() if finding.severity == "error"] == []
            with pytest.raises(ClosedError):
                kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        with pytest.raises(StoreLockedError):
            rtask.open(folder)
    assert not (folder / "published").exists()
    assert not (folder / "followers").exists()
    with rtask.open(folder, mode="r") as kb:
        assert _count(kb) == 10


@pytest.mark.slow
def test_history_and_searches_of_a_reader_see_each_commit(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    with writing(folder) as writer:
        writer.say("add 1")
        with rtask.open(folder, mode="r") as kb:
            latest = writer.say("add 1")
            assert [entry.seq for entry in kb.history(predicate="urn:p")][-1] == latest
            assert kb.search("second") == []  # from here on, the index follows the commits
            writer.say("name second")
            assert [hit.text for hit in kb.search("second")] == ["second"]
            writer.say("place near")
            (place,) = kb.near("urn:table", (0.0, 0.0, 0.0), 1.0)
            assert place.pose.value == "urn:near"


@pytest.mark.slow
def test_subscribers_of_a_reader_hear_of_the_writers_commits(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    with (
        writing(folder) as writer,
        rtask.open(folder, mode="r") as kb,
        kb.subscribe(predicate="urn:p") as changes,
        kb.subscribe_query(COUNT) as rows,
    ):
        assert len(rows.get(20).added) == 1
        seq = writer.say("add 1")
        assert changes.get(20).commit.seq == seq
        assert [row.value("n") for row in rows.get(20).added] == [1]


@pytest.mark.slow
def test_a_reader_follows_bulk_loads_removals_and_the_next_writer(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    (tmp_path / "many.nt").write_text(
        "".join(f"<urn:m{n}> <urn:p> <urn:o{n % 5}> .\n" for n in range(300))
    )
    with writing(folder) as writer, rtask.open(folder, mode="r") as kb:
        writer.say("add 2")
        assert _count(kb) == 2
        writer.say(f"bulk {tmp_path / 'many.nt'}")
        assert _count(kb) == 302
        writer.say("drop")
        assert _count(kb) == 2
        writer.say("add 1")
        assert _count(kb) == 3
        writer.end()
        with writing(folder) as another:
            another.say("add 4")
            assert _count(kb) == 7


@pytest.mark.slow
def test_a_reader_takes_a_large_removal_in_by_loading_what_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replacement, "MIN_REPLACED", 100)
    replaced = []
    real = recovery.replace_contents

    def noted(store: EmbeddedStore, change: Writes) -> None:
        real(store, change)
        replaced.append(len(change.removed))

    monkeypatch.setattr(recovery, "replace_contents", noted)
    folder = tmp_path / "kb"
    with writing(folder) as writer, rtask.open(folder, mode="r") as kb:
        writer.say("add 2")
        writer.say("fill 300")
        assert len(kb.match(None, "urn:q")) == 300
        stopped, seen = threading.Event(), set()

        def read() -> None:
            while True:
                seen.add(_count(kb))
                if stopped.is_set():
                    return

        reading = threading.Thread(target=read)
        reading.start()
        writer.say("empty")
        assert kb.match(None, "urn:q") == []
        stopped.set()
        reading.join()
        assert seen == {2}, "a read saw the store half emptied"
        assert replaced
        assert replaced[0] >= 300
        (row,) = kb.select(COUNT, timeout_s=60.0)  # a reader process gets what stays as well
        assert row.value("n") == 2
        assert [finding for finding in kb.verify() if finding.severity == "error"] == []
        writer.say("add 1")
        assert _count(kb) == 3


@pytest.mark.slow
def test_a_commit_that_the_writer_takes_back_is_forgotten(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    with writing(folder) as writer:
        writer.say("add 2")
        with rtask.open(folder, mode="r") as kb:
            assert _count(kb) == 2
            [segment] = (folder / "journal").glob("*.log")
            whole = segment.read_bytes()
            seq = writer.say("add 1")
            assert _count(kb) == 3
            segment.write_bytes(whole)  # as after a commit for which the disk had no room
            assert (_count(kb), kb.seq) == (2, seq - 1)


@pytest.mark.slow
def test_a_commit_in_the_place_of_one_taken_back_is_read(tmp_path: Path) -> None:
    """The journal may have grown again, and further, before the reader looks."""
    folder = tmp_path / "kb"
    with writing(folder) as writer:
        writer.say("add 2")
        with rtask.open(folder, mode="r") as kb:
            [segment] = (folder / "journal").glob("*.log")
            begin = segment.stat().st_size
            seq = writer.say("add 1")
            assert _count(kb) == 3
            whole = segment.read_bytes()
            lines = [b'A <urn:late%d> <urn:p> "%d" <urn:g> .\n' % (n, n) for n in range(200)]
            header = {"seq": seq, "time": "2030-01-01T00:00:00+00:00", "agent": None, "note": None}
            other = encode({**header, "created": ["urn:g"]}, b"".join(lines))
            assert begin + len(other) > len(whole)
            new = segment.with_suffix(".new")
            new.write_bytes(whole[:begin] + other)
            new.rename(segment)
            assert (_count(kb), kb.seq) == (2 + len(lines), seq)
            segment.write_bytes(whole[:begin])
            shutil.rmtree(folder / "published")
            with pytest.raises(StoreError, match="open the knowledge base again"):
                kb.match("urn:x")


@pytest.mark.slow
def test_what_a_killed_reader_left_is_removed_by_the_next(tmp_path: Path) -> None:
    folder = tmp_path / "kb"
    die = "import os, rtask, sys; rtask.open(sys.argv[1], mode='r').match('urn:x'); os._exit(9)"
    with writing(folder):
        assert run_program(die, str(folder)).returncode == 9
        left = set((folder / "followers").iterdir())
        assert len(left) == 1
        with rtask.open(folder, mode="r"):
            assert left.isdisjoint((folder / "followers").iterdir())


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
