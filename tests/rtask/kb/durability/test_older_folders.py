"""Folders that the first version with a store wrote, closed properly and killed, still open."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

import pytest

import rtask
from rtask.errors import StoreError, StoreFormatError

FOLDERS = Path(__file__).with_name("first_folders.tar.xz")
"""``clean`` and ``killed``: nine commits of several authors, what they derived, and a blob, by a
version whose settings lacked ``union``, ``parent`` and ``store``, and its checkpoint the seal."""


@pytest.fixture
def older(tmp_path: Path) -> Path:
    with tarfile.open(FOLDERS) as archive:
        archive.extractall(tmp_path, filter="data")
    return tmp_path


@pytest.mark.parametrize("folder", ["clean", "killed"])
def test_a_folder_of_the_first_version_opens_whole_and_is_written(older: Path, folder: str) -> None:
    with rtask.open(older / folder, ontologies=False) as kb:
        assert [entry.seq for entry in kb.history()] == list(range(1, 10))
        assert len(kb.match(predicate="urn:p")) == 7
        assert kb.query("ASK { <urn:a> a <urn:Cup> }")
        [quad] = kb.match("urn:view")
        assert kb.blobs.read(quad.object) == b"pixels"  # type: ignore[arg-type]
        assert kb.verify() == []
        assert kb.update("INSERT DATA { <urn:z> a <urn:Mug> }", "nao-1").derived == 1
    with rtask.open(older / folder, mode="r") as kb:
        assert (kb.seq, kb.verify()) == (10, [])


def test_reading_asks_for_the_recovery_of_a_killed_one(older: Path) -> None:
    with rtask.open(older / "clean", mode="r") as kb:
        assert kb.query("ASK { <urn:a> a <urn:Cup> }")
    with pytest.raises(StoreError, match="open it once for writing"):
        rtask.open(older / "killed", mode="r")


@pytest.mark.parametrize(("number", "cure"), [(0, "export it with"), (2, "update RTASK")])
def test_another_format_says_what_to_do_and_changes_nothing(
    older: Path, number: int, cure: str
) -> None:
    settings = older / "clean" / "kb.json"
    settings.write_text(json.dumps(json.loads(settings.read_text()) | {"format": number}))
    before = {path: path.read_bytes() for path in (older / "clean").rglob("*") if path.is_file()}
    with pytest.raises(StoreFormatError, match=cure):
        rtask.open(older / "clean")
    after = {path: path.read_bytes() for path in (older / "clean").rglob("*") if path.is_file()}
    assert after == before
