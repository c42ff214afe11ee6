"""Lock of a folder: only one process writes, and others can find out which one."""

from __future__ import annotations

import datetime as dt
import fcntl
import json
import os
import socket
import sys
from pathlib import Path
from typing import Any

from rtask.errors import StoreLockedError

__all__ = ["FolderLock"]


class FolderLock:
    """An ``flock`` on the file ``lock`` of a knowledge base; released when the process ends.

    Parameters
    ----------
    folder
        The knowledge base.
    shared
        Lock for reading: several readers may hold it together, but no writer.

    Raises
    ------
    StoreLockedError
        Naming the holder.
    """

    def __init__(self, folder: Path, shared: bool = False) -> None:
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC
        self._handle = os.open(folder / "lock", flags, 0o644)
        self._shared = shared
        mode = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        try:
            fcntl.flock(self._handle, mode | fcntl.LOCK_NB)
        except OSError:
            holder = self._read()
            os.close(self._handle)
            raise StoreLockedError(_explain(folder, holder), holder=holder) from None
        if not shared:
            try:
                # The file may name a process that has long ended.
                self._write({})
            except OSError:
                os.close(self._handle)
                raise

    def publish(self, **facts: Any) -> None:
        """Add facts about this process to the lock file, e.g. the ``url`` it serves."""
        self._write({**self._read(), **facts})

    def _write(self, facts: dict[str, Any]) -> None:
        record = {
            "pid": os.getpid(),
            "host": socket.gethostname(),
            "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:3]])[:200],
            "since": dt.datetime.now().astimezone().isoformat(timespec="seconds"),
            **facts,
        }
        text = json.dumps(record).encode()
        # The file stays where it is: a second file of that name could be locked by another process.
        os.ftruncate(self._handle, 0)
        os.pwrite(self._handle, text, 0)

    def _read(self) -> dict[str, Any]:
        try:
            holder: dict[str, Any] = json.loads(os.pread(self._handle, 4096, 0))
        except ValueError:
            return {}
        return holder

    def release(self) -> None:
        """Release the lock."""
        if self._handle < 0:
            return
        if not self._shared:
            # Nobody is named as the holder of a lock that is free.
            os.ftruncate(self._handle, 0)
        os.close(self._handle)
        self._handle = -1


def _is_running(holder: dict[str, Any]) -> bool:
    """Whether the process named in a lock file appears to be running."""
    if not holder:
        return False
    # Processes of another machine cannot be asked; the folder may lie on a shared disk.
    if holder.get("host") != socket.gethostname():
        return True
    try:
        os.kill(int(holder["pid"]), 0)
    except PermissionError:
        return True
    except (OSError, KeyError, ValueError):
        return False
    return True


def _explain(folder: Path, holder: dict[str, Any]) -> str:
    if not _is_running(holder):
        return f"{folder} is open for reading in another process; close it there first"
    since = str(holder.get("since", "?"))
    clock = since[11:16] if since[:10] == dt.date.today().isoformat() else since
    who = f"pid {holder.get('pid')} ({holder.get('command')}) on {holder.get('host')}"
    server = holder.get("url")
    instead = f"use the server at {server}" if server else "close it there first"
    return f"{folder} is open for writing by {who} since {clock}; {instead}"
