"""Blob store: byte strings that the graph names by digest, such as images, clouds and meshes.

A blob is made durable before any statement may name it: it is written to a temporary file and
hashed, followed by fsync, rename and fsync of the folder.
"""

from __future__ import annotations

import ctypes
import hashlib
import io
import os
import re
import secrets
import shutil
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import ontology
from rtask.errors import DataError, MissingBlobError, UsageError
from rtask.kb.durability.disk_space import full_disk, means_full
from rtask.rdf.terms import RDF_TYPE, NamedNode, TripleKey, iri, literal

__all__ = ["Blob", "BlobStore", "digest_of"]

PREFIX = "urn:sha256:"
_IRI = re.compile(PREFIX + r"([0-9a-f]{64})")
_CHUNK = 1 << 20
_MANY = 8


def digest_of(term: NamedNode | str) -> str | None:
    """Return the digest in a blob's IRI, or ``None`` for another IRI.

    >>> digest_of("urn:sha256:" + "0" * 64) == "0" * 64, digest_of("urn:mug")
    (True, None)
    """
    matched = _IRI.fullmatch(term.value if isinstance(term, NamedNode) else term)
    return matched[1] if matched else None


@dataclass(frozen=True)
class Blob:
    """A stored byte string.

    Parameters
    ----------
    sha256
        64 lower-case hexadecimal digits.
    size
        Length in bytes.
    media_type
        IANA media type, e.g. ``image/png``.
    """

    sha256: str
    size: int
    media_type: str

    @property
    def iri(self) -> NamedNode:
        """IRI of the blob in the graph."""
        return NamedNode(PREFIX + self.sha256)

    def statements(self) -> list[TripleKey]:
        """Return the triples that describe the blob."""
        rt = ontology.NS
        return [
            (self.iri, RDF_TYPE, iri(rt + "Blob")),
            (self.iri, iri(rt + "sha256"), literal(self.sha256)),
            (self.iri, iri(rt + "byteLength"), literal(self.size)),
            (self.iri, iri(rt + "mediaType"), literal(self.media_type)),
        ]


class BlobStore:
    """Content-addressed files below one folder, or in memory.

    Attributes
    ----------
    fetch
        Returns a missing byte string by its digest from elsewhere, or raises
        :class:`MissingBlobError`.
    """

    def __init__(self, folder: Path | None, writable: bool = True) -> None:
        self._folder = folder
        self._writable = writable
        self._memory: dict[str, bytes] = {}
        self.fetch: Callable[[str], bytes] | None = None
        if folder is not None and writable:
            (folder / "tmp").mkdir(parents=True, exist_ok=True)

    def put(
        self, data: bytes | Path | BinaryIO, media_type: str = "application/octet-stream"
    ) -> Blob:
        """Store bytes, the content of a file or a stream; equal content is stored once.

        Raises
        ------
        StorageFullError
            If the disk is full; nothing is stored.
        """
        if not self._writable:
            raise UsageError("blobs cannot be stored: the knowledge base is open for reading only")
        if self._folder is None:
            content = data if isinstance(data, bytes) else _read_all(data)
            digest = hashlib.sha256(content).hexdigest()
            self._memory[digest] = content
            return Blob(digest, len(content), media_type)
        try:
            return self._put_file(self._folder, data, media_type)
        except OSError as error:
            # No room for a new file need not mean that the bytes are not there already.
            if not means_full(error):
                raise
            stored = self._stored(data, media_type) if isinstance(data, bytes) else None
            if stored is None:
                raise full_disk(self._folder, "to store a blob; nothing was stored") from error
            return stored

    def _stored(self, data: bytes, media_type: str) -> Blob | None:
        """Return the blob of bytes that are stored already, as new as if they had been sent now."""
        digest = hashlib.sha256(data).hexdigest()
        if not (self.has(PREFIX + digest) and self.is_sound(digest)):
            return None
        # Clean-up spares what is new: whoever sends bytes is about to name them.
        os.utime(self._place(digest))
        return Blob(digest, len(data), media_type)

    def put_many(self, contents: Iterable[bytes]) -> list[Blob]:
        """Store many byte strings; all are durable when it returns.

        One flush of the whole file system stands for one of each file and folder, which is what
        takes the time with small files.

        Raises
        ------
        StorageFullError
            If the disk is full; what was written until then is deleted.
        """
        every = list(contents)
        # One sync of the file system costs more than a few of single files.
        if len(every) < _MANY or self._folder is None or not self._writable:
            return [self.put(data) for data in every]
        digests = [hashlib.sha256(data).hexdigest() for data in every]
        temporaries = [self._folder / "tmp" / secrets.token_hex(8) for _ in every]
        try:
            for temporary, data in zip(temporaries, every, strict=True):
                temporary.write_bytes(data)
            _sync_file_system(self._folder)
            # Only now may a name lead to the bytes: they are on the disk.
            for temporary, digest in zip(temporaries, digests, strict=True):
                final = self._place(digest)
                final.parent.mkdir(parents=True, exist_ok=True)
                temporary.replace(final)
        except OSError as error:
            if means_full(error):
                raise full_disk(self._folder, "to store blobs") from error
            raise
        finally:
            for temporary in temporaries:
                temporary.unlink(missing_ok=True)
        # Once more for the names.
        _sync_file_system(self._folder)
        kind = "application/octet-stream"
        return [Blob(name, len(data), kind) for name, data in zip(digests, every, strict=True)]

    def _put_file(self, folder: Path, data: bytes | Path | BinaryIO, media_type: str) -> Blob:
        temporary = folder / "tmp" / secrets.token_hex(8)
        digest, size = hashlib.sha256(), 0
        try:
            with temporary.open("xb") as out:
                # Hashed while it is written: a stream can be read only once.
                for chunk in _chunks(data):
                    digest.update(chunk)
                    size += len(chunk)
                    out.write(chunk)
                out.flush()
                os.fsync(out.fileno())
            final = self._place(digest.hexdigest())
            final.parent.mkdir(parents=True, exist_ok=True)
            temporary.replace(final)
        finally:
            temporary.unlink(missing_ok=True)
        # A name is durable once its folder is, and a new folder once its parent is (fsync(2)).
        for parent in (final.parent, final.parent.parent, folder):
            sync_folder(parent)
        return Blob(digest.hexdigest(), size, media_type)

    def _place(self, digest: str) -> Path:
        assert self._folder is not None
        return self._folder / digest[:2] / digest[2:4] / digest

    def has(self, name: NamedNode | str) -> bool:
        """Whether the bytes of this IRI are stored."""
        digest = digest_of(name)
        if digest is None:
            return False
        return digest in self._memory if self._folder is None else self._place(digest).is_file()

    def path(self, name: NamedNode | str) -> Path:
        """Return the file of a blob.

        Raises
        ------
        MissingBlobError
            If the blob is missing, or this store keeps its blobs in memory.
        """
        digest = self.require(name)
        if self._folder is None:
            raise MissingBlobError(f"{name}: a store in memory has no files; use read()")
        return self._place(digest)

    def open(self, name: NamedNode | str) -> BinaryIO:
        """Open a blob for reading."""
        if self._folder is None:
            return io.BytesIO(self.read(name))
        return self.path(name).open("rb")

    def read(self, name: NamedNode | str) -> bytes:
        """Return the bytes of a blob.

        Raises
        ------
        MissingBlobError
            If the blob is missing.
        """
        digest = self.require(name)
        return self._memory[digest] if self._folder is None else self._place(digest).read_bytes()

    def require(self, name: NamedNode | str) -> str:
        """Return the digest of a blob, which is stored here after that.

        Raises
        ------
        MissingBlobError
            If the blob is missing.
        """
        digest = digest_of(name)
        if digest is None:
            raise DataError(
                f"{name} is not the IRI of a blob; expected {PREFIX}<64 hexadecimal digits>"
            )
        if not self.has(name) and self.fetch is not None:
            data = self.fetch(digest)
            if hashlib.sha256(data).hexdigest() != digest:
                raise MissingBlobError(f"the blob {PREFIX}{digest} was damaged on its way")
            self.put(data)
        if not self.has(name):
            raise MissingBlobError(f"the blob {PREFIX}{digest} is not stored here", blob=digest)
        return digest

    def digests(self) -> Iterator[str]:
        """Yield the digest of every stored blob."""
        if self._folder is None:
            yield from list(self._memory)
            return
        for file in sorted(self._folder.glob("??/??/*")):
            yield file.name

    def discard(self, digest: str, older_than_s: float) -> bool:
        """Delete a blob stored more than ``older_than_s`` seconds ago; return whether it was."""
        if self._folder is None:
            return older_than_s <= 0 and self._memory.pop(digest, None) is not None
        file = self._place(digest)
        if time.time() - file.stat().st_mtime < older_than_s:
            return False
        file.unlink()
        return True

    def is_sound(self, digest: str) -> bool:
        """Whether the stored bytes still match their digest."""
        sha256 = hashlib.sha256()
        with self.open(PREFIX + digest) as file:
            for chunk in iter(lambda: file.read(_CHUNK), b""):
                sha256.update(chunk)
        return sha256.hexdigest() == digest


def sync_folder(folder: Path) -> None:
    """Make the directory entries of a folder durable."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _sync_file_system(folder: Path) -> None:
    """Make everything durable on the file system that holds a folder."""
    libc = ctypes.CDLL(None, use_errno=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        if not hasattr(libc, "syncfs"):
            os.sync()
        elif libc.syncfs(handle) != 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number), str(folder))
    finally:
        os.close(handle)


def _read_all(data: Path | BinaryIO) -> bytes:
    return data.read_bytes() if isinstance(data, Path) else data.read()


def _chunks(data: bytes | Path | BinaryIO) -> Iterator[bytes]:
    if isinstance(data, bytes):
        yield data
    elif isinstance(data, Path):
        with data.open("rb") as file:
            yield from iter(lambda: file.read(_CHUNK), b"")
    else:
        yield from iter(lambda: data.read(_CHUNK), b"")


def copy_blob(source: Path, target: Path) -> None:
    """Copy a blob's file, sharing its bytes where the file system can."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
