"""Documents from files, bytes or standard input, decompressed while they are read."""

from __future__ import annotations

import codecs
import gzip
import hashlib
import io
import sys
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, cast

from rtask.errors import DataError, ParseError, TooLargeError, UsageError

__all__ = ["Document"]

MAX_UNPACKED = 4 << 30
_HEAD = 4096
_BUFFER = 1 << 18
_PACKED_BYTES = 1 << 12
"""Bytes that are unpacked at a time; a hostile file makes of each some thirty thousand."""
_PACKINGS = (".gz", ".zst", ".zip")


@dataclass(frozen=True)
class Document:
    """A document that can be read repeatedly from its start.

    Parameters
    ----------
    name
        Name for messages: the path, ``<stdin>`` or ``<bytes>``.
    path
        The file; ``None`` for bytes.
    data
        The bytes; ``None`` for a file.
    on_read
        Called with the number of stored bytes read so far.
    max_unpacked
        Maximum decompressed size in bytes; reading beyond it is an error.
    """

    name: str
    path: Path | None = None
    data: bytes = b""
    on_read: Callable[[int], None] | None = field(default=None, compare=False, repr=False)
    max_unpacked: int = field(default_factory=lambda: MAX_UNPACKED)

    @classmethod
    def of(cls, source: Path | str | bytes | IO[bytes]) -> Document:
        """Return the document of a path, bytes, an open file, or ``-`` for standard input.

        Raises
        ------
        UsageError
            If the path does not exist, or it is a file of text.
        """
        if isinstance(source, bytes):
            return cls("<bytes>", data=source)
        if source == "-":
            return cls("<stdin>", data=sys.stdin.buffer.read())
        if isinstance(source, str | Path):
            path = Path(source)
            if not path.exists():
                raise UsageError(f"{path} does not exist")
            if path.is_fifo():  # such as the shell's <(...), which can be read only once
                return cls(str(path), data=path.read_bytes())
            return cls(str(path), path)
        data = source.read() if hasattr(source, "read") else source
        if not isinstance(data, bytes):
            raise UsageError(
                f"expected a path, bytes or a file opened with mode 'rb', not {source!r}"
            )
        return cls(getattr(source, "name", "<stream>"), data=data)

    @property
    def stem(self) -> str:
        """The file's name without compression suffix and extension; ``data`` without a file."""
        return Path(self._unpacked_name).stem if self.path else "data"

    @property
    def extension(self) -> str:
        """The extension before any compression suffix, in lower case and without dot."""
        return Path(self._unpacked_name).suffix.lower().lstrip(".") if self.path else ""

    @property
    def _unpacked_name(self) -> str:
        name = self.path.name if self.path else self.name
        return name.rpartition(".")[0] if name.lower().endswith(_PACKINGS) else name

    @property
    def size(self) -> int:
        """Stored length in bytes, compressed or not."""
        return self.path.stat().st_size if self.path else len(self.data)

    def open(self) -> IO[bytes]:
        """Open the document for reading, decompressed and without its byte order mark.

        Raises
        ------
        ParseError
            If it is not UTF-8 text.
        """
        packed = self.path.open("rb") if self.path else io.BytesIO(self.data)
        try:
            stream = io.BufferedReader(_Limited(self._unpack(packed), packed, self), _BUFFER)
            head = stream.peek(_HEAD)[:_HEAD]
            _refuse_binary(self.name, head)
        except BaseException:
            packed.close()
            raise
        if head.startswith(b"\xef\xbb\xbf"):
            stream.read(3)
        return stream

    def _unpack(self, packed: IO[bytes]) -> IO[bytes]:
        start = packed.read(4)
        packed.seek(0)
        if start[:2] == b"\x1f\x8b":
            return cast("IO[bytes]", gzip.GzipFile(fileobj=packed))
        if start == b"\x28\xb5\x2f\xfd":
            return cast("IO[bytes]", _Zstandard(packed))
        if start == b"PK\x03\x04":
            return self._only_member(packed)
        return packed

    def _only_member(self, packed: IO[bytes]) -> IO[bytes]:
        try:
            archive = zipfile.ZipFile(packed)
            members = [info for info in archive.infolist() if not info.is_dir()]
            if len(members) != 1:
                raise DataError(
                    f"{self.name} holds {len(members)} files; expected a zip archive of one file"
                )
            return archive.open(members[0])
        except (zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
            # NotImplementedError: its compression; RuntimeError: it is encrypted
            raise ParseError(f"{self.name}: {error}") from error

    def sha256(self) -> str:
        """Return the SHA-256 digest of the stored bytes, 64 hexadecimal digits."""
        with self.path.open("rb") if self.path else io.BytesIO(self.data) as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()

    def head(self) -> bytes:
        """Return the first 4096 bytes, decompressed."""
        with self.open() as stream:
            return stream.read(_HEAD)

    def text(self) -> str:
        """Return the whole document as text.

        Raises
        ------
        ParseError
            If it is not UTF-8.
        """
        with self.open() as stream:
            data = stream.read()
        try:
            return data.decode("utf-8")
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            raise ParseError(f"{self.name}:{line}: not UTF-8", line=line) from error


class _Zstandard:
    """Unpacks all frames of a stream, and fails where the last one is cut off.

    The library's own reader takes the end of what is there for the end of the frame.
    """

    def __init__(self, packed: IO[bytes]) -> None:
        self._packed = packed
        self._next = b""
        self._frame: Any = None
        self._ready = io.BytesIO()

    def read(self, size: int) -> bytes:
        """Return up to so many bytes; none at the end."""
        from zstandard import ZstdDecompressor, ZstdError

        while not (data := self._ready.read(size)):
            packed = self._next or self._packed.read(_PACKED_BYTES)
            if not packed:
                if self._frame is not None:
                    raise EOFError("it ends within a frame")
                return b""
            self._frame = self._frame or ZstdDecompressor().decompressobj()
            try:
                self._ready = io.BytesIO(self._frame.decompress(packed))
            except ZstdError as error:
                raise OSError(str(error)) from error
            self._next = b""
            if self._frame.eof:
                self._next, self._frame = self._frame.unused_data, None
        return data

    def close(self) -> None:
        """Do nothing: who opened the stream closes it."""


class _Limited(io.RawIOBase):
    """Limits the decompressed size, so that a small file cannot fill the memory."""

    def __init__(self, stream: IO[bytes], packed: IO[bytes], document: Document) -> None:
        self._stream = stream
        self._packed = packed
        self._name = document.name
        self._on_read = document.on_read
        self._left = self._allowed = document.max_unpacked

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: object) -> int:
        view = memoryview(buffer)  # type: ignore[arg-type]
        try:
            data = self._stream.read(len(view))
        except (OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            raise ParseError(f"{self._name}: cannot be unpacked: {error}") from error
        self._left -= len(data)
        if self._left < 0:
            raise TooLargeError(f"{self._name}: larger than {self._allowed >> 20} MiB unpacked")
        if self._on_read is not None:
            self._on_read(self._packed.tell())
        view[: len(data)] = data
        return len(data)

    def close(self) -> None:
        self._stream.close()
        self._packed.close()
        super().close()


def _refuse_binary(name: str, head: bytes) -> None:
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise ParseError(f"{name}:1:1: UTF-16; expected UTF-8", line=1, column=1)
    if b"\0" in head and not _is_text(head):
        raise ParseError(f"{name}: binary data; expected text in UTF-8")


def _is_text(head: bytes) -> bool:
    """Whether a head that holds NUL is UTF-8: literals may hold it (RDF 1.1 N-Triples, 7).

    Formats of files without text are hardly ever valid UTF-8, and every second byte or more is
    NUL in UTF-16 and UTF-32 without a mark.
    """
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return False
    return head[0] != 0 and head.count(0) * 4 < len(head)
