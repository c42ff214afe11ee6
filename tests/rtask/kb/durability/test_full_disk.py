"""A disk that is really full: nothing half stored, reads go on, writes go on once there is room."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import rtask
from rtask.errors import StorageFullError
from rtask.knowledge_base import KnowledgeBase

_MIB = 1 << 20


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 24 MiB, 6 of them taken by the file ``ballast``."""
    place = tmp_path / "disk"
    place.mkdir()
    if os.geteuid() != 0:
        pytest.skip("mounting a small disk needs root")
    command = ["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", str(place)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no file systems can be mounted here")
    (place / "ballast").write_bytes(bytes(6 * _MIB))
    yield place
    subprocess.run(["umount", str(place)], check=True)


def _fill(kb: KnowledgeBase) -> int:
    """Write until there is no room; return how many commits were acknowledged."""
    for number in range(4_000):
        try:
            with kb.transaction("nao-1") as tx:
                for part in range(60):
                    tx.add(f"urn:s{number}:{part}", "urn:p", "x" * 200 + str(part))
        except StorageFullError:
            return number
    raise AssertionError("the disk is larger than it should be")


def _count(kb: KnowledgeBase) -> object:
    return kb.select("SELECT (COUNT(*) AS ?n) { ?s <urn:p> ?o }")[0].value("n")


@pytest.mark.slow
def test_a_full_disk_stops_writes_until_there_is_room(small_disk: Path) -> None:
    folder = small_disk / "kb"
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        image = kb.blobs.put(b"pixels")
        stored = _fill(kb)
        assert _count(kb) == stored * 60
        with pytest.raises(StorageFullError):
            kb.update("INSERT DATA { <urn:a> <urn:p> 1 }")
        with pytest.raises(StorageFullError):
            kb.blobs.put(bytes(24 * _MIB))
        with pytest.raises(StorageFullError):
            kb.blobs.put_many([bytes([number]) * 4 * _MIB for number in range(8)])
        assert list(kb.blobs.digests()) == [image.sha256]
        assert not list((folder / "blobs" / "tmp").iterdir())
        assert _count(kb) == stored * 60
        (small_disk / "ballast").unlink()
        assert kb.update("INSERT DATA { <urn:a> <urn:p> 1 }").seq == stored + 1
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        assert (kb.seq, _count(kb)) == (stored + 1, stored * 60 + 1)
        assert [f for f in kb.verify() if f.severity == "error"] == []


@pytest.mark.slow
def test_a_folder_closed_on_a_full_disk_opens_again(small_disk: Path) -> None:
    folder = small_disk / "kb"
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        stored = _fill(kb)
    (small_disk / "ballast").unlink()
    with rtask.open(folder, ontologies=False, reason=False) as kb:
        assert (kb.seq, _count(kb)) == (stored, stored * 60)
