"""Records are found by number and time without reading those before; what is withdrawn is not."""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import pytest

import rtask
from rtask.errors import StoreError
from rtask.kb.durability.journal import CommitRecord, JournalFile
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import Literal, NamedNode, Quad

NOON = dt.datetime(2026, 1, 2, 12, tzinfo=dt.UTC)


def _record(journal: JournalFile, seq: int, size: int = 1, minute: int | None = None) -> None:
    at = NOON + dt.timedelta(minutes=seq if minute is None else minute)
    quads = [Quad(NamedNode("urn:s"), NamedNode("urn:p"), Literal(n)) for n in range(size)]
    journal.append(CommitRecord(seq, at, at, None, "reader"), Writes(added=quads))


def _marks(journal: JournalFile, seq: int = 0) -> list[tuple[int, int]]:
    return [(mark.seq, mark.changed) for mark in journal.marks.after(seq)]


def test_what_was_withdrawn_is_forgotten_and_its_number_used_again(tmp_path: Path) -> None:
    journal = JournalFile(tmp_path / "journal", durable=False)
    _record(journal, 1)
    _record(journal, 2, size=9)
    assert _marks(journal) == [(1, 1), (2, 9)]
    journal.withdraw()
    assert _marks(journal) == [(1, 1)]
    _record(journal, 2, size=9)
    journal.withdraw()
    _record(journal, 2, size=30)
    assert _marks(journal) == [(1, 1), (2, 30)]
    for mark in journal.marks.after(0):
        record = next(journal.records_from(mark.segment, mark.start))
        assert (record.seq, len(record.added())) == (mark.seq, mark.changed)
    journal.close()


def test_a_record_that_is_being_written_counts_once_it_is_whole(tmp_path: Path) -> None:
    journal = JournalFile(tmp_path / "journal", durable=False)
    _record(journal, 1)
    _record(journal, 2)
    journal.close()
    [segment] = journal.segments()
    whole = segment.read_bytes()
    for torn in (whole[:-1], whole[: whole.rindex(b'{"seq"') + 20]):
        segment.write_bytes(torn)
        again = JournalFile(tmp_path / "journal")
        assert _marks(again) == [(1, 1)]
        segment.write_bytes(whole)
        assert _marks(again, 1) == [(2, 1)]
    segment.write_bytes(whole[:-1])
    (tmp_path / "journal" / f"{3:016d}.log").write_bytes(b"")
    with pytest.raises(StoreError, match="damaged record before its end"):
        _marks(JournalFile(tmp_path / "journal"))


def test_of_a_clock_that_was_set_back_the_number_decides(tmp_path: Path) -> None:
    journal = JournalFile(tmp_path / "journal", durable=False)
    for seq, minute in enumerate((0, 50, 10, 20, 60), 1):
        _record(journal, seq, minute=minute)
    for minute, seq in ((0, 1), (9, 1), (15, 3), (30, 4), (55, 4), (60, 5)):
        first, last = journal.marks.at(NOON + dt.timedelta(minutes=minute))
        assert (first and first.seq, last and last.seq) == (1, seq)
    assert journal.marks.at(NOON - dt.timedelta(minutes=1))[1] is None
    journal.close()


def test_an_earlier_state_is_made_without_the_records_before_it(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", reason=False, ontologies=False) as kb:
        for number in range(4):
            kb.update(f"INSERT DATA {{ <urn:a> <urn:p> {number} }}")
        [segment] = (tmp_path / "kb" / "journal").iterdir()
        data = bytearray(segment.read_bytes())
        data[data.index(b"urn:a") + 4] = ord("b")  # of the first commit
        segment.write_bytes(bytes(data))
        assert list(kb.history("urn:a")) == [], "nothing is read beyond the damage"
        with kb.as_of(kb.seq - 1) as past:
            assert len(past.match("urn:a")) == 3
