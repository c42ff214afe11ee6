"""Opening and closing: what is refused says why and what to do."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import warnings
from pathlib import Path

import pytest

import rtask
from rtask.errors import (
    ClosedError,
    StoreError,
    StoreFormatError,
    StoreLockedError,
    UsageError,
)


def _bare(path: Path, **options: object) -> rtask.KnowledgeBase:
    return rtask.open(path, ontologies=False, reason=False, **options)


def test_a_folder_is_made_and_found_again(tmp_path: Path) -> None:
    with _bare(tmp_path / "kb") as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        base = kb.base
    assert re.fullmatch(r"https://w3id\.org/rtask-kg/kb/[0-9a-f]{12}/", base)
    with _bare(tmp_path / "kb") as kb:
        assert kb.base == base
        assert kb.query("ASK { <urn:a> <urn:p> 1 }") is True
        assert kb.seq == 1


def test_the_lock_names_who_holds_the_folder_and_where_it_is_served(tmp_path: Path) -> None:
    with _bare(tmp_path) as kb:
        with pytest.raises(StoreLockedError, match=rf"pid {os.getpid()} \(.*close it there first"):
            _bare(tmp_path)
        kb.publish(url="http://127.0.0.1:8765/sparql")
        with pytest.raises(StoreLockedError, match=r"use the server at http://127\.0\.0\.1:8765"):
            _bare(tmp_path)


def _hold(path: Path, ready: object, done: object) -> None:
    with _bare(path):
        ready.set()  # type: ignore[attr-defined]
        done.wait(60)  # type: ignore[attr-defined]


def test_another_process_is_locked_out_until_the_first_ends(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    ready, done = context.Event(), context.Event()
    child = context.Process(target=_hold, args=(tmp_path, ready, done))
    child.start()
    try:
        assert ready.wait(60)
        with pytest.raises(StoreLockedError, match=f"pid {child.pid}"):
            _bare(tmp_path)
    finally:
        done.set()
        child.join(60)
    _bare(tmp_path).close()


def test_readers_share_a_folder_and_cannot_write(tmp_path: Path) -> None:
    with _bare(tmp_path) as kb:
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
    with _bare(tmp_path, mode="r") as one, _bare(tmp_path, mode="r") as two:
        assert len(one.match("urn:a")) == len(two.match("urn:a")) == 1
        with pytest.raises(ClosedError, match="reading only"):
            one.update("INSERT DATA { <urn:a> <urn:p> 2 }")
        with pytest.raises(StoreLockedError, match="open for reading in another process"):
            _bare(tmp_path)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"format": 99}, "newer format 99, this version reads 1; update RTASK"),
        ({"format": 0}, "older format 0"),
        ({}, 'damaged: it is no JSON object with a number "format"'),
        ([1, 2], 'damaged: it is no JSON object with a number "format"'),
        ({"format": "old"}, 'damaged: it is no JSON object with a number "format"'),
        ({"format": 1, "base": "urn:x/"}, "it lacks created, epoch, plain, store_id; restore it"),
    ],
)
def test_another_format_is_refused(tmp_path: Path, given: object, message: str) -> None:
    (tmp_path / "kb.json").write_text(json.dumps(given))
    with pytest.raises(StoreFormatError, match=message):
        _bare(tmp_path)


def test_a_folder_without_what_later_versions_added_is_opened_and_written(tmp_path: Path) -> None:
    place = tmp_path / "kb"
    with rtask.open(place, ontologies=False) as kb:
        data = "<urn:C> rdfs:subClassOf <urn:D> . <urn:a> a <urn:C>"
        rdfs = "PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>"
        kb.update(f"{rdfs} INSERT DATA {{ {data} }}")
        base = kb.base
    settings = json.loads((place / "kb.json").read_text())
    kept = ("store_id", "epoch", "base", "plain", "created", "format")
    (place / "kb.json").write_text(json.dumps({name: settings[name] for name in kept}))
    for file in (*place.glob("closure-*/*"), *place.glob("reserve"), place / "lock"):
        file.unlink()
    (place / "blobs" / "tmp").rmdir()
    (place / "blobs").rmdir()
    with rtask.open(place, ontologies=False) as kb:
        assert (kb.base, kb.seq) == (base, 1)
        assert kb.query("ASK { <urn:a> a <urn:D> }") is True
        assert kb.update("INSERT DATA { <urn:b> a <urn:C> }").derived == 1
        assert kb.blobs.has(kb.blobs.put(b"bytes").iri)
        assert kb.verify() == [] or [f.severity for f in kb.verify()] == ["note"]


def test_what_is_no_knowledge_base_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(StoreFormatError, match="is not a knowledge base"):
        _bare(tmp_path)
    with pytest.raises(StoreFormatError, match="is a file"):
        _bare(tmp_path / "notes.txt")
    with pytest.raises(StoreFormatError, match="is not a knowledge base"):
        _bare(tmp_path / "absent", mode="r")
    assert not (tmp_path / "absent").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot create a knowledge base"):
        _bare(tmp_path / "file" / "kb")


def test_the_kind_of_a_store_is_fixed_when_it_is_made(tmp_path: Path) -> None:
    with _bare(tmp_path, base="urn:lab/"):
        pass
    with pytest.raises(StoreFormatError, match="has the base urn:lab/"):
        _bare(tmp_path, base="urn:other/")
    with pytest.raises(StoreFormatError, match="plain"):
        _bare(tmp_path, plain=True)
    with pytest.raises(StoreFormatError, match="already"):
        _bare(tmp_path, mode="new")
    with _bare(tmp_path / "plain", plain=True):
        pass
    with rtask.open(tmp_path / "plain") as kb:
        assert kb.plain


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"mode": "a"}, UsageError),
        ({"flush": "later"}, UsageError),
        ({"base": "urn:lab"}, UsageError),
        ({"validate": "maybe"}, UsageError),
    ],
)
def test_wrong_options_are_named(options: dict[str, object], error: type[Exception]) -> None:
    with pytest.raises(error):
        rtask.open(":memory:", **options)


def test_an_address_of_another_scheme_is_not_taken_for_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"one begins with http://"):
        rtask.open("ftp://host/sparql")
    assert not list(tmp_path.iterdir())


def test_a_closed_knowledge_base_says_so() -> None:
    kb = _bare(":memory:")  # type: ignore[arg-type]
    kb.close()
    kb.close()
    for use in (
        lambda: kb.query("ASK {}"),
        lambda: kb.match(),
        lambda: kb.update("CLEAR ALL"),
        lambda: kb.transaction().__enter__(),
    ):
        with pytest.raises(ClosedError):
            use()


def test_an_unclosed_folder_warns_and_an_error_does_not_keep_it_locked(tmp_path: Path) -> None:
    kb = _bare(tmp_path)
    with pytest.raises(rtask.errors.QuerySyntaxError) as caught:
        kb.update("INSERT nonsense")
    kb.close()
    _bare(tmp_path).close()  # although the traceback in `caught` still names the closed one
    assert caught.value.details["line"] == 1
    kb = _bare(tmp_path)
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        kb.__del__()
    kb.close()
    assert [w.category for w in seen] == [ResourceWarning]


def test_a_folder_whose_making_was_interrupted_can_be_made(tmp_path: Path) -> None:
    (tmp_path / "kb.tmp").write_text("{")
    rtask.open(tmp_path, ontologies=False, reason=False).close()
    rtask.open(tmp_path, mode="r", ontologies=False, reason=False).close()
