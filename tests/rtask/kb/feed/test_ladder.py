"""Earlier states are reached from the nearest kept one, and are the same as without any."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

import rtask
from rtask.errors import UnsupportedError
from rtask.kb.durability import ladder as ladders
from rtask.kb.durability.ladder import Ladder
from rtask.kb.feed import as_of
from rtask.knowledge_base import KnowledgeBase

_SPACING = 60


@pytest.fixture
def spacing(monkeypatch: pytest.MonkeyPatch) -> int:
    """Keep a copy after so few statements, so that a small store has many."""
    monkeypatch.setattr(as_of, "SPACING", _SPACING)
    return _SPACING


@pytest.fixture
def kb(tmp_path: Path, spacing: int) -> Iterator[KnowledgeBase]:
    with rtask.open(tmp_path / "kb", ontologies=False, reason=False) as opened:
        yield opened


def content(kb: KnowledgeBase) -> set[str]:
    named = {str(row) for row in kb.select("SELECT * { GRAPH ?g { ?s ?p ?o } }")}
    return named | {str(row) for row in kb.select("SELECT * { ?s ?p ?o }")}


def live(kb: KnowledgeBase, commits: int, seed: int) -> dict[int, set[str]]:
    """Write at random, graphs that come and go included; return what each commit left."""
    rng = random.Random(seed)
    states = {kb.seq: content(kb)}
    for _ in range(commits):
        graph, number = rng.choice("abc"), rng.randrange(12)
        what = rng.random()
        if what < 0.1:
            kb.update(f"DROP SILENT GRAPH <urn:g{graph}>")
        elif what < 0.3:
            kb.update(f"DELETE WHERE {{ GRAPH ?g {{ <urn:s{number}> ?p ?o }} }}")
        else:
            kb.update(f"INSERT DATA {{ GRAPH <urn:g{graph}> {{ <urn:s{number}> <urn:p> {number}, "
                      f"{rng.randrange(5)} }} }}")  # fmt: skip
        states[kb.seq] = content(kb)
    return states


def ladder_of(kb: KnowledgeBase) -> Ladder:
    ladder = kb._files.ladder
    assert ladder is not None
    return ladder


def test_each_earlier_state_is_as_it_was_from_whichever_side_it_is_reached(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    states = live(kb, 40, 1)
    seqs = sorted(states)
    assert ladder_of(kb).seqs() == []
    for seq in (seqs[0], *random.Random(2).sample(seqs, 12)):
        with kb.as_of(seq) as past:
            assert content(past) == states[seq]
    kept = ladder_of(kb).seqs()
    assert len(kept) > 4
    far = kb.changed_since(seqs[2])
    assert max(map(kb.replayed_for, seqs)) <= 2 * _SPACING < far, "but for one commit beyond"
    kb.close()
    with rtask.open(tmp_path / "kb") as again:
        assert ladder_of(again).seqs() == kept, "a restart keeps them"
        for seq in random.Random(3).sample(seqs, 6):
            with again.as_of(seq) as past:
                assert content(past) == states[seq]
        with again.branch(at=seqs[3]) as branch:
            assert content(branch.graph) == states[seqs[3]]


def test_copies_are_bounded_and_those_further_back_go_first(kb: KnowledgeBase) -> None:
    states = live(kb, 40, 4)
    seqs = sorted(states)
    ladder = ladder_of(kb)
    ladder._max_rungs = 4
    with kb.as_of(seqs[0]) as past:
        assert content(past) == states[seqs[0]]
    kept = ladder.seqs()
    assert len(kept) == 4
    ladder._max_bytes = ladder.own_bytes() - 1
    with kb.as_of(seqs[0]), kb.as_of(seqs[len(seqs) // 2]) as past:
        assert content(past) == states[seqs[len(seqs) // 2]]
    assert ladder.own_bytes() <= ladder._max_bytes or len(ladder.seqs()) == 1


def test_copies_of_another_epoch_or_boot_or_without_their_files_are_not_used(
    kb: KnowledgeBase, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    states = live(kb, 30, 5)
    seqs = sorted(states)
    kb.as_of(seqs[0]).close()
    kept = ladder_of(kb).seqs()
    store = tmp_path / "kb" / "past" / str(kept[0]) / "store"
    (store / "CURRENT").unlink()
    with kb.as_of(seqs[1]) as past:
        assert content(past) == states[seqs[1]], "from the next one, or the present"
    assert kept[0] not in ladder_of(kb).seqs() or (store / "CURRENT").exists()
    kb.close()
    monkeypatch.setattr(ladders, "boot_id", lambda: "another")
    with rtask.open(tmp_path / "kb") as again:
        assert ladder_of(again).seqs() == []
        with again.as_of(seqs[2]) as past:
            assert content(past) == states[seqs[2]]


def test_what_a_bulk_load_hides_from_one_side_is_reached_from_the_other(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    states = live(kb, 25, 6)
    seqs = sorted(states)
    kb.as_of(seqs[0]).close()
    assert ladder_of(kb).seqs()
    file = tmp_path / "many.nt"
    file.write_text("".join(f"<urn:m{k}> <urn:p> {k} .\n".replace(f" {k} .", f' "{k}" .')
                            for k in range(2_000)), "utf-8")  # fmt: skip
    kb.load(file, graph="urn:gm")
    with kb.as_of(seqs[3]) as past:
        assert content(past) == states[seqs[3]]
    ladder_of(kb).clear()
    if any(map(as_of.may_lack_some, as_of.records_after(kb._files.journal, seqs[-1]))):
        with pytest.raises(UnsupportedError):
            kb.as_of(seqs[3])
