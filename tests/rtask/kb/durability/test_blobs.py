"""Blobs: durable before they are named, found by their digest."""

from __future__ import annotations

import errno
import hashlib
import io
import os
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.errors import DataError, MissingBlobError, StorageFullError, UsageError
from rtask.kb.durability import blobs as blobs_module
from rtask.kb.durability.blobs import BlobStore

_DATA = b"a cup, seen from above"
_DIGEST = hashlib.sha256(_DATA).hexdigest()


@pytest.fixture(params=["folder", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> BlobStore:
    return BlobStore(tmp_path / "blobs" if request.param == "folder" else None)


def test_bytes_files_and_streams_come_back(store: BlobStore, tmp_path: Path) -> None:
    file = tmp_path / "cup.png"
    file.write_bytes(_DATA)
    for source in (_DATA, file, io.BytesIO(_DATA)):
        blob = store.put(source, "image/png")
        assert (blob.sha256, blob.size, blob.media_type) == (_DIGEST, len(_DATA), "image/png")
        assert blob.iri.value == f"urn:sha256:{_DIGEST}"
        assert store.has(blob.iri)
        assert store.read(blob.iri) == _DATA
        with store.open(blob.iri.value) as opened:
            assert opened.read() == _DATA
    assert list(store.digests()) == [_DIGEST]
    assert store.is_sound(_DIGEST)


def test_what_is_not_there_or_no_blob_is_named(store: BlobStore) -> None:
    absent = "urn:sha256:" + "0" * 64
    assert not store.has(absent)
    assert not store.has("urn:mug")
    with pytest.raises(MissingBlobError, match="is not stored here"):
        store.read(absent)
    with pytest.raises(DataError, match="is not the IRI of a blob"):
        store.read("urn:sha256:../../etc/passwd")


def test_many_that_find_the_disk_full_leave_no_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, write = BlobStore(tmp_path), Path.write_bytes
    room = iter(range(9))

    def until_full(path: Path, data: bytes) -> int:
        if next(room) < 8:
            return write(path, data)
        write(path, data[:1])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", until_full)
    with pytest.raises(StorageFullError):
        store.put_many([bytes([number, number]) for number in range(10)])
    assert list((tmp_path / "tmp").iterdir()) == list(store.digests()) == []


def test_files_lie_by_digest_and_leave_no_rest(tmp_path: Path) -> None:
    store = BlobStore(tmp_path)
    blob = store.put(_DATA)
    path = store.path(blob.iri)
    assert path == tmp_path / _DIGEST[:2] / _DIGEST[2:4] / _DIGEST
    assert list((tmp_path / "tmp").iterdir()) == []
    path.write_bytes(b"other bytes")
    assert not store.is_sound(_DIGEST)


def test_a_blob_is_synced_before_it_gets_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events: list[str] = []
    sync, replace = os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda handle: (events.append("sync"), sync(handle))[1])
    monkeypatch.setattr(
        Path, "replace", lambda self, to: (events.append("name"), replace(self, to))[1]
    )
    BlobStore(tmp_path).put(_DATA)
    assert events[:2] == ["sync", "name"]
    assert "sync" in events[2:]  # of the folder


def test_a_full_disk_keeps_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = BlobStore(tmp_path)

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(blobs_module.os, "fsync", full)
    with pytest.raises(StorageFullError):
        store.put(_DATA)
    assert not store.has(f"urn:sha256:{_DIGEST}")
    assert list((tmp_path / "tmp").iterdir()) == []
    monkeypatch.undo()
    stored = store.put(_DATA)
    monkeypatch.setattr(blobs_module.os, "fsync", full)
    assert store.put(_DATA) == stored  # needs no room
    store.path(stored.iri).write_bytes(b"damaged")
    with pytest.raises(StorageFullError):
        store.put(_DATA)


def test_a_transaction_describes_its_blob_and_none_may_name_what_is_missing(
    tmp_path: Path,
) -> None:
    with rtask.open(tmp_path, ontologies=False, reason=False) as kb:
        with kb.transaction(agent="nao-1") as tx:
            name = tx.blob(_DATA, "image/png")
            tx.add("urn:view", "urn:image", name)
        found = {q.predicate.value.removeprefix(ontology.NS): q.object for q in kb.match(name)}
        assert found["sha256"].value == _DIGEST  # type: ignore[union-attr]
        assert found["byteLength"].value == str(len(_DATA))  # type: ignore[union-attr]
        assert found["mediaType"].value == "image/png"  # type: ignore[union-attr]
        for missing in ("0" * 64, "not-a-digest"):
            with pytest.raises(MissingBlobError):
                kb.update(f"INSERT DATA {{ <urn:v> <urn:image> <urn:sha256:{missing}> }}")
        assert kb.seq == 1
    with (
        rtask.open(tmp_path, mode="r") as kb,
        pytest.raises(UsageError, match="reading only"),
    ):
        kb.blobs.put(_DATA)
