"""The body of a request while it arrives: small ones in memory, large ones in a file.

A client may take minutes over a large upload, and only its whole is of use: until the last byte is
there, the others need not be in memory.
"""

from __future__ import annotations

import asyncio
import tempfile
from typing import IO

from rtask.errors import StorageFullError

SMALL_BYTES = 4 << 20


class Spool:
    """Collects pieces.

    Parameters
    ----------
    small
        Bytes that stay in memory.

    Examples
    --------
    >>> spool = Spool(small=4)
    >>> for piece in (b"abc", b"def"):
    ...     spool.write(piece)
    >>> spool.in_file, asyncio.run(spool.read())
    (True, b'abcdef')
    >>> spool.close()
    """

    def __init__(self, small: int = SMALL_BYTES) -> None:
        self._small = small
        self._pieces: list[bytes] = []
        self._size = 0
        self._file: IO[bytes] | None = None

    @property
    def in_file(self) -> bool:
        """Whether there is a file."""
        return self._file is not None

    def write(self, piece: bytes) -> None:
        """Take a piece.

        Raises
        ------
        StorageFullError
            There is no room for the file.
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
            raise StorageFullError(f"no room for a large body in {folder}: {error}") from None

    async def read(self) -> bytes:
        """Return all of it."""
        if self._file is None:
            return self._pieces[0] if len(self._pieces) == 1 else b"".join(self._pieces)
        self._file.seek(0)
        return await asyncio.get_running_loop().run_in_executor(None, self._file.read)

    def close(self) -> None:
        """Let it go, and the file too."""
        self._pieces = []
        if self._file is not None:
            self._file.close()
