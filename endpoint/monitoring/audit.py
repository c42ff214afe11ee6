"""Audit trail: changes and refused requests, one JSON line each, in ``audit.jsonl``.

The journal and the provenance graph record every commit as statements. This trail is for operators:
it adds what never became a commit, and stays readable when the store is not. The file is in the
data folder, with mode 0600; beyond 64 MiB it is rotated to ``audit.jsonl.1``.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any, TextIO

from endpoint.access.rate import Buckets
from endpoint.monitoring.log import redacted, timestamp
from rtask.kb.commit.commit import Change

FILE_NAME = "audit.jsonl"
MAX_BYTES = 64 << 20
_MAX_LINES = 500
_DENIALS_PER_S = 50.0
_log = logging.getLogger(__name__)


class Audit:
    """The audit trail of one server.

    Parameters
    ----------
    folder
        Data folder; none to keep only the last events, in memory.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = folder / FILE_NAME if folder else None
        self._lock = threading.Lock()
        self._recent: deque[dict[str, Any]] = deque(maxlen=_MAX_LINES)
        self._file: TextIO | None = None
        # A caller that is refused a thousand times a second must not fill the disk.
        self._denials = Buckets(_DENIALS_PER_S)
        self._untold = 0

    def commit(self, change: Change) -> None:
        """Record a commit; its note names request and token."""
        self._write(
            {
                "event": "commit",
                "seq": change.commit.seq,
                "agent": change.agent,
                "note": change.note,
                "graphs": sorted(getattr(graph, "value", "") for graph in change.graphs),
                "added": change.commit.added,
                "removed": change.commit.removed,
                "derived": change.commit.derived,
            }
        )

    def denied(self, status: int, detail: str, **facts: Any) -> None:
        """Record a request that was refused for lack of rights."""
        if self._denials.take("denied"):
            self._untold += 1
            return
        untold, self._untold = self._untold, 0
        more = {"untold_before": untold} if untold else {}
        self._write({"event": "denied", "status": status, **facts, "detail": detail[:500], **more})

    def event(self, name: str, **facts: Any) -> None:
        """Record another event: a token created, a sign-in, start or stop."""
        self._write({"event": name, **facts})

    def recent(self, count: int = 200) -> list[dict[str, Any]]:
        """Return the last events, newest first."""
        with self._lock:
            return list(self._recent)[-count:][::-1]

    def _write(self, facts: dict[str, Any]) -> None:
        line = {"time": timestamp(time.time()), **facts}
        text = redacted(json.dumps(line, ensure_ascii=False, default=str))
        with self._lock:
            self._recent.append(line)
            if self._path is None:
                return
            try:
                self._open(self._path).write(text + "\n")
            except OSError as error:
                _log.error("the audit trail cannot be written: %s", error)

    def _open(self, path: Path) -> TextIO:
        if self._file is not None and self._file.tell() > MAX_BYTES:
            self._file.close()
            path.replace(path.with_suffix(".jsonl.1"))
            self._file = None
        if self._file is None:
            # Opened with the right mode from the start, line by line from there on.
            handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
            self._file = os.fdopen(handle, "a", buffering=1, encoding="utf-8")
        return self._file

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            file, self._file = self._file, None
            try:
                if file is not None:
                    file.close()
            except OSError as error:
                _log.error("the end of the audit trail cannot be written: %s", error)
