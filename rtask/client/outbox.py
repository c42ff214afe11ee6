"""Calls that could not be delivered yet, in a file that survives the robot's program.

One JSON object a line: an entry when it is written, ``{"done": id}`` when it has been answered.
Each line is on the disk before anything is sent. A line that was cut off by a crash was never
acknowledged to anybody and is dropped.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import uuid
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Entry", "Outbox"]

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Entry:
    """A call that has to be made."""

    id: str
    operation: str
    args: dict[str, Any]


class Outbox:
    """A durable queue of calls.

    Parameters
    ----------
    path
        File; made with its folder when missing. One program at a time.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     box = Outbox(Path(folder) / "outbox.jsonl")
    ...     entry = box.add("report_outcome", {"task_id": "t-1"})
    ...     waiting = [e.operation for e in Outbox(box.path).pending()]
    ...     box.done(entry)
    ...     waiting, Outbox(box.path).pending()
    (['report_outcome'], [])
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._lock = threading.Lock()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._pending = {entry.id: entry for entry in _read(self.path)}
        # Lines of what was answered long ago, and one that a crash cut off, go at each start.
        self._rewrite()

    def pending(self) -> list[Entry]:
        """Return what has not been answered, the oldest first."""
        with self._lock:
            return list(self._pending.values())

    def add(self, operation: str, args: dict[str, Any]) -> Entry:
        """Keep a call until :meth:`done`; it is on the disk when this returns."""
        entry = Entry(uuid.uuid4().hex, operation, args)
        with self._lock:
            self._append({"id": entry.id, "operation": operation, "args": args})
            self._pending[entry.id] = entry
        return entry

    def done(self, entry: Entry) -> None:
        """Forget a call that has been answered."""
        with self._lock:
            self._pending.pop(entry.id, None)
            if self._pending:
                self._append({"done": entry.id})
            else:
                # Empty is the usual state, so that the file stays short without being rewritten
                # each time.
                self._rewrite()

    def refuse(self, entry: Entry, reason: str) -> None:
        """Put a call aside that the server will not take, beside the file, for a person to see."""
        aside = self.path.with_name(self.path.name + ".refused")
        line = {"operation": entry.operation, "args": entry.args, "reason": reason}
        with aside.open("a", encoding="utf-8") as file:
            # Kept before it is forgotten: between the two it is there twice, and never not at all.
            file.write(json.dumps(line) + "\n")
        log.error("%s was refused: %s; kept in %s", entry.operation, reason, aside)
        self.done(entry)

    def _append(self, line: dict[str, Any]) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
            file.flush()
            os.fsync(file.fileno())

    def _rewrite(self) -> None:
        """Write only what is pending; the old file stays until the new one is complete."""
        fresh = self.path.with_name(self.path.name + ".new")
        with fresh.open("w", encoding="utf-8") as file:
            for entry in self._pending.values():
                line = {"id": entry.id, "operation": entry.operation, "args": entry.args}
                file.write(json.dumps(line) + "\n")
            file.flush()
            os.fsync(file.fileno())
        # A rename is atomic: whoever reads meanwhile sees either file, and both are whole.
        fresh.replace(self.path)
        if os.name == "posix":
            folder = os.open(self.path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)


def _read(path: Path) -> list[Entry]:
    if not path.exists():
        return []
    entries: dict[str, Entry] = {}
    for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            line = json.loads(text)
            if "done" in line:
                entries.pop(line["done"], None)
            else:
                entries[line["id"]] = Entry(line["id"], line["operation"], line["args"])
        except (json.JSONDecodeError, KeyError, TypeError):
            log.warning("%s:%d was cut off and is dropped", path, number)
    return list(entries.values())
