"""Nothing acknowledged is lost, nothing is torn: kills, torn journals, stores that lag behind."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import rtask
from rtask.errors import StorageFullError, StoreError, StoreFormatError
from rtask.kb.durability import journal as journal_module
from rtask.kb.durability.journal import JournalFile
from rtask.kb.durability.recovery import Checkpoint
from rtask.kb.store.apply import apply
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import BlankNode, iri
from tests.commands import run_program

_KILLS = Path(__file__).parents[3] / "benchmarks" / "kb" / "stress_kills.py"


def _bare(path: Path, **options: object) -> KnowledgeBase:
    return rtask.open(path, ontologies=False, reason=False, **options)


@pytest.mark.slow
@pytest.mark.parametrize("kills", [6, pytest.param(20, marks=pytest.mark.deep)])
def test_kills_lose_nothing_acknowledged_and_tear_nothing(kills: int) -> None:
    """The short form of the stress test; its 200 kills take a minute."""
    done = subprocess.run(
        [sys.executable, str(_KILLS), "--kills", str(kills), "--seed", "7"],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    outcomes = re.search(rf"{kills} kills, none lost or torn: (\d+) outcomes", done.stdout)
    assert outcomes is not None, done.stdout
    assert int(outcomes[1]) > 0


_LARGE = 2_000
_HALF = """
import os, sys
import rtask
from rtask.kb.commit import committer
from rtask.kb.store import commit_writes, embedded
from rtask.kb.store.embedded import EmbeddedStore

committer.LARGE = commit_writes.LARGE = embedded.LARGE = int(sys.argv[3])
kb = rtask.open(sys.argv[1], ontologies=False, reason=False)
kb.update("INSERT DATA { <urn:old> <urn:p> 1 }")
with kb.transaction() as tx:
    tx.remove("urn:old", "urn:p", 1)
    for number in range(int(sys.argv[3])):
        tx.add(f"urn:s{number}", "urn:p", number)
    if sys.argv[2] == "between":
        EmbeddedStore.update = lambda *_, **__: os._exit(9)
    else:
        EmbeddedStore.bulk_extend = lambda *_, **__: os._exit(9)
"""


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["before", "between"])
def test_a_large_change_killed_between_its_steps_is_completed(tmp_path: Path, moment: str) -> None:
    done = run_program(_HALF, str(tmp_path), moment, str(_LARGE))
    assert done.returncode == 9
    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        assert kb.seq == 2
        assert kb.match("urn:old") == []
        assert len(kb.match(None, "urn:p")) == _LARGE
        assert kb.verify() == []


def _write_some(folder: Path) -> None:
    with _bare(folder) as kb:
        node = BlankNode()
        with kb.transaction(agent="nao-1") as tx:
            tx.add(node, "urn:p", "a blank node's\nword")
            tx.add("urn:a", "urn:p", 1)
        kb.update("DELETE DATA { <urn:a> <urn:p> 1 } ; INSERT DATA { <urn:a> <urn:p> 2 }", "nao-1")
        kb.update("CREATE GRAPH <urn:empty>")
        kb.update("INSERT DATA { GRAPH <urn:g> { <urn:b> <urn:p> <<( <urn:x> <urn:y> 1 )>> } }")
        kb.update("DROP GRAPH <urn:g>")


def _content(folder: Path) -> tuple[set[str], set[str]]:
    with _bare(folder) as kb:
        quads = kb.store.quads_for_pattern(None, None, None)
        return set(map(str, quads)), set(map(str, kb.store.named_graphs()))


def test_a_store_that_lost_everything_is_restored_from_the_journal(tmp_path: Path) -> None:
    _write_some(tmp_path)
    before = _content(tmp_path)
    shutil.rmtree(tmp_path / "store")
    Checkpoint(0, clean=False).save(tmp_path)
    assert _content(tmp_path) == before


def test_replaying_what_the_store_holds_already_changes_nothing(tmp_path: Path) -> None:
    _write_some(tmp_path)
    before = _content(tmp_path)
    for _ in range(2):
        Checkpoint(0, clean=False).save(tmp_path)
        assert _content(tmp_path) == before


def test_a_torn_end_is_cut_and_the_rest_kept(tmp_path: Path) -> None:
    _write_some(tmp_path)
    whole = _content(tmp_path)
    [segment] = (tmp_path / "journal").iterdir()
    size = segment.stat().st_size
    with segment.open("ab") as file:
        file.write(b'{"seq": 6, "bytes": 400, "crc32": 1}\nA <urn:half')
    Checkpoint(0, clean=False).save(tmp_path)
    assert _content(tmp_path) == whole
    assert segment.stat().st_size == size
    with _bare(tmp_path) as kb:
        assert kb.update("INSERT DATA { <urn:after> <urn:p> 1 }").seq == 6
        assert [entry.seq for entry in kb.history("urn:after")] == [6]


def test_a_store_ahead_of_the_journal_goes_on_counting(tmp_path: Path) -> None:
    """After a power cut the store may hold a commit whose record was lost."""
    _write_some(tmp_path)
    [segment] = (tmp_path / "journal").iterdir()
    records = list(JournalFile(tmp_path / "journal").records())
    last = records[-1]
    header = json.dumps(last.header, ensure_ascii=False).encode() + b"\n"
    with segment.open("rb+") as file:
        file.truncate(segment.stat().st_size - len(header) - len(last.body))
    Checkpoint(0, clean=False).save(tmp_path)
    with _bare(tmp_path) as kb:
        assert kb.seq == last.seq
        assert kb.update("INSERT DATA { <urn:after> <urn:p> 1 }").seq == last.seq + 1
        assert kb.verify() == []


def test_damage_before_the_end_is_reported_and_not_passed_over(tmp_path: Path) -> None:
    _write_some(tmp_path)
    journal = tmp_path / "journal"
    [segment] = journal.iterdir()
    data = bytearray(segment.read_bytes())
    data[len(data) // 2] ^= 1
    segment.write_bytes(bytes(data))
    (journal / f"{99:016d}.log").write_bytes(b"")
    Checkpoint(0, clean=False).save(tmp_path)
    with pytest.raises(StoreError, match="damaged record before its end"):
        _bare(tmp_path)


def test_an_unclean_folder_is_not_read_before_it_is_recovered(tmp_path: Path) -> None:
    _write_some(tmp_path)
    Checkpoint(0, clean=False).save(tmp_path)
    with pytest.raises(StoreError, match="open it once for writing"):
        _bare(tmp_path, mode="r")
    _bare(tmp_path).close()
    _bare(tmp_path, mode="r").close()
    (tmp_path / "checkpoint.json").write_text("{")
    with pytest.raises(StoreFormatError, match="damaged"):
        _bare(tmp_path, mode="r")
    _bare(tmp_path).close()
    _bare(tmp_path, mode="r").close()


def test_a_full_disk_stores_nothing_and_writing_goes_on_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with _bare(tmp_path) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        real = os.write

        def half(handle: int, data: bytes) -> int:
            if len(data) > 50:
                return real(handle, data[:50])
            raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(journal_module.os, "write", half)
        with pytest.raises(StorageFullError, match="journal"):
            kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
        monkeypatch.setattr(journal_module.os, "write", real)
        assert len(kb.match("urn:a")) == 1
        assert kb.update("INSERT DATA { <urn:a> <urn:p> 3 }").seq == 2
        assert kb.verify() == []


def test_a_store_that_fails_takes_its_record_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with _bare(tmp_path) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")

        def fail(*args: object) -> None:
            raise OSError("IO error")

        monkeypatch.setattr("rtask.kb.commit.committer.apply", fail)
        with pytest.raises(OSError, match="IO error"):
            kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
        monkeypatch.undo()
        kb.update("INSERT DATA { <urn:a> <urn:p> 3 }")
        assert [entry.seq for entry in kb.history()] == [1, 2]
        assert len(kb.match("urn:a")) == 2


@pytest.mark.parametrize("stored", [True, False])
def test_an_interrupted_write_is_completed_by_opening_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stored: bool
) -> None:
    with _bare(tmp_path) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")

        def interrupted(*args: object) -> None:
            if stored:
                apply(*args)  # type: ignore[arg-type]
            raise KeyboardInterrupt

        monkeypatch.setattr("rtask.kb.commit.committer.apply", interrupted)
        with pytest.raises(KeyboardInterrupt):
            kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
        monkeypatch.undo()
        with pytest.raises(StoreError, match="open the knowledge base again"):
            kb.update("INSERT DATA { <urn:a> <urn:p> 3 }")
    with _bare(tmp_path) as kb:
        assert kb.seq == 2
        assert len(kb.match("urn:a")) == 2
        assert kb.verify() == []


def test_a_number_used_again_is_forced_to_the_disk_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with _bare(tmp_path) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        forced: list[int] = []
        real = os.fdatasync
        monkeypatch.setattr(os, "fdatasync", lambda h: (forced.append(h), real(h))[1])

        def fail(*args: object) -> None:
            kb._writer.committer.journal.sync(2)  # another thread's fsync comes in between
            raise OSError("IO error")

        monkeypatch.setattr("rtask.kb.commit.committer.apply", fail)
        with pytest.raises(OSError, match="IO error"):
            kb.update("INSERT DATA { <urn:a> <urn:p> 2 }")
        monkeypatch.setattr("rtask.kb.commit.committer.apply", apply)
        before = len(forced)
        assert kb.update("INSERT DATA { <urn:a> <urn:p> 3 }").seq == 2
        assert len(forced) == before + 1


def test_weak_flushing_after_a_restart_of_the_machine_is_a_new_epoch(tmp_path: Path) -> None:
    with _bare(tmp_path, flush="os") as kb:
        epoch = kb.settings.epoch
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    with _bare(tmp_path) as kb:
        assert kb.settings.epoch == epoch
    Checkpoint(0, clean=False, boot="another", durable=False).save(tmp_path)
    with _bare(tmp_path) as kb:
        assert kb.settings.epoch != epoch
        assert len(kb.match("urn:a")) == 1


def test_segments_are_turned_over_and_old_ones_forgotten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal_module, "SEGMENT_BYTES", 2_000)
    with _bare(tmp_path) as kb:
        for number in range(12):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}")
        segments = sorted((tmp_path / "journal").iterdir())
        assert len(segments) > 2
        assert [entry.seq for entry in kb.history(since=9)] == [10, 11, 12]
        monkeypatch.setattr(journal_module, "_RETAINED_BYTES", 2_000)
        kb.checkpoint()
        kept = sorted((tmp_path / "journal").iterdir())
        assert kept == segments[-len(kept) :]
        assert len(kept) < len(segments)
        assert kb.verify() == []


def test_a_clock_set_ahead_by_years_deletes_no_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal_module, "SEGMENT_BYTES", 2_000)
    ahead = time.time() + 4 * 366 * 86_400
    with _bare(tmp_path) as kb:
        for number in range(12):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}")
        for segment in (tmp_path / "journal").iterdir():
            os.utime(segment, (0, 0))  # as if a clock that was years behind had been set
        monkeypatch.setattr(time, "time", lambda: ahead)
        kb.checkpoint()
        kb.update("INSERT DATA { <urn:a> <urn:p> 13 }")
        kb.checkpoint()
        assert [entry.seq for entry in kb.history()] == list(range(1, 14))


def test_an_interrupted_large_load_is_completed_at_the_next_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    graph = iri("urn:big")
    data = "".join(f"<urn:s{n}> <urn:p> {n} .\n" for n in range(300))
    monkeypatch.setattr("rtask.loader.load.MAX_QUADS", 100)
    folder = tmp_path / "kb"
    with _bare(folder) as kb:

        def killed(*args: object) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr("rtask.kb.commit.bulk.finish_bulk", killed)
        with pytest.raises(KeyboardInterrupt):
            kb.load(data.encode(), format="turtle", graph=graph)
        monkeypatch.undo()
    with _bare(folder) as kb:
        assert kb.catalogue.triple_count(graph) == 300
        assert not (folder / "loading.json").exists()
        assert [f for f in kb.verify() if f.severity == "error"] == []
