"""Kept facts of stored views outlive the process, and are never trusted blindly."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest

from features.recognition import Recogniser, RecognitionIndex, ViewFeatures
from features.recognition.comparison.known import Known
from features.recognition.comparison.store_facts import StoreFacts
from features.recognition.comparison.support import ViewPair
from features.recognition.comparison.votes import Votes

pytestmark = pytest.mark.slow

Views = dict[str, list[ViewFeatures]]


@pytest.fixture(scope="module")
def views(card_views) -> Views:
    """Three cards of three views; what is asked comes last."""
    return {f"card {k}": card_views(k, 4) for k in range(3)}


@pytest.fixture
def compared(monkeypatch) -> list[tuple[str, str]]:
    """Pairs of views that were compared since."""
    pairs: list[tuple[str, str]] = []
    compare = StoreFacts._compared

    def counted(facts, snapshot, view, other, drawn):
        pairs.append((snapshot.view_iris[view], snapshot.view_iris[other]))
        return compare(facts, snapshot, view, other, drawn)

    monkeypatch.setattr(StoreFacts, "_compared", counted)
    return pairs


def add(index: RecognitionIndex, views: Views, name: str, k: int, thing: str = "") -> None:
    index.add(f"{name}/{k}", thing or name, "class:card", views[name][k])


def learn(folder: Path, views: Views) -> None:
    """Store two views of each card as the engine does: each is prepared when it was added."""
    with RecognitionIndex(folder) as index:
        recogniser = Recogniser(index)
        for name in views:
            for k in range(2):
                add(index, views, name, k)
                recogniser.prepare([f"{name}/{k}"])


@contextmanager
def opened(folder: Path) -> Iterator[Recogniser]:
    with RecognitionIndex(folder) as index:
        yield Recogniser(index)


def facts_of(recogniser: Recogniser) -> dict[str, tuple]:
    snapshot, found = recogniser.index.snapshot(), {}
    for view in np.flatnonzero(snapshot.alive).tolist():
        of = recogniser._facts.of(snapshot, view)
        found[snapshot.view_iris[view]] = (
            of.own.tolist(), of.shared.tolist(), of.support.tolist(), of.verified, of.unlike
        )  # fmt: skip
    return found


def fresh_facts(recogniser: Recogniser) -> dict[str, tuple]:
    """Compute the facts of the same views without anything that was kept."""
    snapshot, memory = recogniser.index.snapshot(), RecognitionIndex()
    fresh = Recogniser(memory)
    memory._snapshot = snapshot  # the same rows: neighbours are found the same way
    return facts_of(fresh)


def file_of(folder: Path) -> Path:
    return folder / "facts.sqlite"


def test_nothing_is_compared_again_after_a_start(tmp_path, views, compared) -> None:
    learn(tmp_path, views)
    assert compared
    compared.clear()
    with opened(tmp_path) as recogniser:
        for name, seen in views.items():
            assert recogniser.recognise(seen[3]).accepts(name)
        assert not compared
        assert facts_of(recogniser) == fresh_facts(recogniser)


def test_a_view_that_comes_after_a_start_is_compared_alone(tmp_path, views, compared) -> None:
    learn(tmp_path, views)
    compared.clear()
    with opened(tmp_path) as recogniser:
        add(recogniser.index, views, "card 0", 2)
        recogniser.prepare(["card 0/2"])
        assert compared
        assert all("card 0/2" in pair for pair in compared)
        compared.clear()
        recogniser.recognise(views["card 0"][3])
    assert not compared


def test_what_changed_without_the_file_is_noticed(tmp_path, views) -> None:
    learn(tmp_path, views)
    with RecognitionIndex(tmp_path) as index:  # nobody recognises meanwhile
        index.remove("card 0/0")
        index.relabel("card 1/1", "card 2")
        add(index, views, "card 2", 2)
        index.add("card 2/0", "card 2", "class:card", views["card 1"][2])  # replaced
        index.save()
    with opened(tmp_path) as recogniser:
        assert facts_of(recogniser) == fresh_facts(recogniser)
    with opened(tmp_path) as recogniser:
        assert facts_of(recogniser) == fresh_facts(recogniser)


def test_an_index_that_was_made_again_keeps_what_is_known(tmp_path, views, compared) -> None:
    learn(tmp_path, views)
    compared.clear()
    stored = [(f"{n}/{k}", n, "class:card", views[n][k].to_bytes()) for n in views for k in (1, 0)]
    with RecognitionIndex.rebuild(tmp_path, stored) as index:
        Recogniser(index).recognise(views["card 1"][3])
    assert not compared


@pytest.mark.parametrize("damage", ["no database", "cut short", "a record", "a change", "rules"])
def test_a_damaged_or_old_file_is_made_again_with_a_word(
    tmp_path, views, compared, caplog, damage: str
) -> None:
    learn(tmp_path, views)
    file = file_of(tmp_path)
    if damage == "no database":
        file.write_bytes(b"facts " * 1000)
    elif damage == "cut short":
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    else:
        spoil = {
            "a record": "update record set content = zeroblob(length(content))",
            "a change": "update change set id = 3 where place = 1",
            "rules": "update rules set name = 'of another version'",
        }
        with closing(sqlite3.connect(file)) as connection, connection:
            connection.execute(spoil[damage])
    compared.clear()
    with caplog.at_level(logging.WARNING), opened(tmp_path) as recogniser:
        assert facts_of(recogniser) == fresh_facts(recogniser)
        assert recogniser.recognise(views["card 0"][3]).accepts("card 0")
    assert compared
    assert "facts.sqlite" in caplog.text
    with opened(tmp_path) as recogniser:  # whole again, at the latest after one more start
        facts_of(recogniser)
    compared.clear()
    caplog.clear()
    with opened(tmp_path) as recogniser:
        facts_of(recogniser)
    assert not compared
    assert not caplog.records


def test_a_second_recogniser_and_a_reader_leave_the_file_alone(tmp_path, views) -> None:
    learn(tmp_path, views)
    with opened(tmp_path) as first:
        second = Recogniser(first.index)
        reader = Recogniser(RecognitionIndex(tmp_path, mode="r"))
        for recogniser in (first, second, reader):
            assert recogniser.recognise(views["card 2"][3]).accepts("card 2")
        assert facts_of(second) == facts_of(first)
        reader.index.close()
    with opened(tmp_path) as again:
        assert facts_of(again) == fresh_facts(again)


def test_what_was_forgotten_is_compared_again(tmp_path, views, compared) -> None:
    learn(tmp_path, views)
    with opened(tmp_path) as recogniser:
        recogniser.forget_comparisons()
        assert not list(tmp_path.glob("facts.sqlite*"))
    compared.clear()
    with opened(tmp_path) as recogniser:
        recogniser.recognise(views["card 0"][3])
    assert compared


def test_a_record_of_an_earlier_version_is_read() -> None:
    """It ends behind the comparisons that count, and has cells for every view."""
    one, near, cells = np.ones(2, np.int64), np.zeros(2, np.int32), np.packbits(np.ones(9, bool))
    pairs = {2: ViewPair(near, cells, cells), 5: ViewPair(near, cells, cells)}
    known = Known(7, Votes(one, near, one, near), (2,), (5,), pairs)
    earlier = known.to_bytes()[:-4]
    read = Known.from_bytes(7, earlier)
    assert (read.own, read.others, read.different) == ((2,), (5,), frozenset())
    assert read.to_bytes() == known.to_bytes()
