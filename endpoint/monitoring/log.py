"""Logging as JSON lines, one for each request and each log record; on a terminal in words.

A separate thread writes the lines, so that a terminal or pipe that nobody reads cannot block the
server. Lines that cannot be written in time are dropped and counted.
"""

from __future__ import annotations

import datetime as dt
import json
import logging
import re
import sys
import threading
from collections import deque
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, TextIO

_EVERY_S = 0.2
_MAX_LINES = 20_000
_SECRET = re.compile(r"(token=|rtk_[0-9a-f]{12}_|ticket=)[^&\s\"']*")


# Always the same encoder: `json.dumps` with options makes one for each line.
as_json = json.JSONEncoder(ensure_ascii=False, default=str).encode


def redacted(text: str) -> str:
    """Replace the secrets of tokens in a text.

    Examples
    --------
    >>> redacted("GET /?token=rtk_0123456789ab_secret&x=1")
    'GET /?token=***&x=1'
    """
    if "t" not in text or ("=" not in text and "rtk_" not in text):
        return text
    return _SECRET.sub(lambda match: match.group(1) + "***", text)


def in_words(line: Mapping[str, Any]) -> str:
    """Return a line as a person reads it: the time of day, and what was asked or said.

    Examples
    --------
    >>> in_words({"time": "2026-01-01T10:00:00.000+00:00", "level": "warning", "message": "full"})
    '10:00:00 warning: full'
    >>> in_words({"time": "2026-01-01T10:00:00.000+00:00", "method": "GET", "path": "/objects",
    ...           "status": 200, "ms": 12.5, "agent": "ann"})
    '10:00:00 200 GET /objects, 12 ms, ann'
    """
    clock = str(line.get("time", ""))[11:19]
    if "path" not in line:
        level = str(line.get("level", "info"))
        text = f"{'' if level == 'info' else f'{level}: '}{line.get('message', '')}"
        return "\n".join([f"{clock} {text}", *filter(None, [line.get("exception")])])
    who = line.get("agent") or line.get("role")
    asked = f"{clock} {line['status']} {line['method']} {line['path']}, {line['ms']:.0f} ms"
    return f"{asked}, {who}" if who else asked


def _spoken(line: Mapping[str, Any] | str) -> str:
    return in_words(json.loads(line) if isinstance(line, str) else line)


def _encoded(line: Mapping[str, Any] | str) -> str:
    return line if isinstance(line, str) else as_json(line)


class LineWriter:
    """Writes lines to a stream from a thread of its own.

    Parameters
    ----------
    stream
        Output stream; standard error by default.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream
        self._lines: deque[Mapping[str, Any] | str] = deque()
        self._wake = threading.Event()
        self._closed = False
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def put(self, line: Mapping[str, Any] | str) -> None:
        """Queue a line, or its JSON, without waiting."""
        if len(self._lines) >= _MAX_LINES:
            self.dropped += 1
            return
        self._lines.append(line)

    def _run(self) -> None:
        while not self._closed:
            self._wake.wait(_EVERY_S)
            self._flush()
        self._flush()

    def _flush(self) -> None:
        stream = self._stream or sys.stderr
        written = _spoken if stream.isatty() else _encoded
        texts = []
        while self._lines:
            texts.append(written(self._lines.popleft()))
        if not texts:
            return
        try:
            stream.write("\n".join(texts) + "\n")
            stream.flush()
        except (OSError, ValueError):
            self.dropped += len(texts)  # the reader has gone

    def close(self) -> None:
        """Write the queued lines, waiting for a second at most."""
        self._closed = True
        self._wake.set()
        self._thread.join(1.0)


class JsonHandler(logging.Handler):
    """Hands the records of :mod:`logging` to a :class:`LineWriter`."""

    def __init__(self, writer: LineWriter) -> None:
        super().__init__()
        self._writer = writer

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        line: dict[str, Any] = {
            "time": timestamp(record.created),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": redacted(record.getMessage()),
        }
        if record.exc_info and record.exc_info[0] is not None:
            line["exception"] = redacted(logging.Formatter().formatException(record.exc_info))
        self._writer.put(line)


def timestamp(seconds: float) -> str:
    """Format a time in ISO 8601, in UTC, to the millisecond."""
    whole = int(seconds)
    return f"{_second(whole)}.{int((seconds - whole) * 1_000):03}+00:00"


@lru_cache(maxsize=8)
def _second(seconds: int) -> str:
    return dt.datetime.fromtimestamp(seconds, dt.UTC).strftime("%Y-%m-%dT%H:%M:%S")


def log_as_json(writer: LineWriter, level: str) -> None:
    """Send all logging of this process to a writer."""
    root = logging.getLogger()
    root.handlers[:] = [JsonHandler(writer)]
    root.setLevel(getattr(logging, level.upper(), logging.WARNING))
    # Both log each request at INFO, with its whole address, which may hold a token.
    for chatty in ("httpx", "uvicorn.access"):
        logging.getLogger(chatty).setLevel(logging.WARNING)
