"""Buffer for the body of a request while it arrives: in memory if small, in a file if large.

A client may take minutes over a large upload, and only the whole of it is of use. Until the last
byte has arrived, the others need not occupy memory.
"""

from __future__ import annotations

import asyncio
import tempfile
from typing import IO

from rtask.errors import StorageFullError

SMALL_BYTES = 4 << 20


class BodyBuffer:
    """Collects the pieces of a body.

    Parameters
    ----------
    small
        Largest size, in bytes, that stays in memory.

    Examples
    --------
    >>> buffer = BodyBuffer(small=4)
    >>> for piece in (b"abc", b"def"):
    ...     buffer.write(piece)
    >>> buffer.in_file, asyncio.run(buffer.read())
    (True, b'abcdef')
    >>> buffer.close()
    """

    def __init__(self, small: int = SMALL_BYTES) -> None:
        self._small = small
        self._pieces: list[bytes] = []
        self._size = 0
        self._file: IO[bytes] | None = None

    @property
    def in_file(self) -> bool:
        """Whether the body is in a file."""
        return self._file is not None

    def write(self, piece: bytes) -> None:
        """Append a piece.

        Raises
        ------
        StorageFullError
            There is no disk space for the file.
        """
        self._size += len(piece)
        try:
            if self._file is not None:
                self._file.write(piece)
                return
            self._pieces.append(piece)
            if self._size > self._small:
                self._file = tempfile.TemporaryFile()  # noqa: SIM115 - close() closes it
                self._file.writelines(self._pieces)
                self._pieces = []
        except OSError as error:
            folder = tempfile.gettempdir()
            raise StorageFullError(f"no disk space for a large body in {folder}: {error}") from None

    async def read(self) -> bytes:
        """Return the whole body."""
        if self._file is None:
            return self._pieces[0] if len(self._pieces) == 1 else b"".join(self._pieces)
        self._file.seek(0)
        return await asyncio.get_running_loop().run_in_executor(None, self._file.read)

    def close(self) -> None:
        """Release the memory and the file."""
        self._pieces = []
        if self._file is not None:
            self._file.close()
