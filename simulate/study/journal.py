"""Journal of an experiment: a header and one line per finished trial, append-only.

Each line is on disk before the next trial is handed out, so that a crash loses at most the trials
in progress.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rtask.errors import UsageError

__all__ = ["Journal"]

_HEADER = "study"


class Journal:
    """An append-only file of JSON lines.

    Parameters
    ----------
    path
        The file; it is created, with its folder, if missing.
    settings
        Everything that identifies an experiment: its name, its seed, and all settings on which a
        trial depends, but not the number of trials or processes.
    resume
        Whether to continue an existing file.

    Raises
    ------
    UsageError
        The file exists and ``resume`` is off, or is of an experiment with other settings.

    Examples
    --------
    >>> import tempfile
    >>> from contextlib import closing
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "journal.jsonl"
    ...     with closing(Journal(path, {"seed": 1})) as journal:
    ...         journal.append(0, {"held": True})
    ...     with closing(Journal(path, {"seed": 1}, resume=True)) as journal:
    ...         journal.done
    {0: {'held': True}}
    """

    def __init__(self, path: Path, settings: Mapping[str, Any], resume: bool = False) -> None:
        self.path = Path(path)
        self.done: dict[int, dict[str, Any]] = {}
        settings = json.loads(json.dumps(settings))
        whole = 0
        if self.path.exists() and self.path.stat().st_size:
            if not resume:
                raise UsageError(
                    f"{self.path} holds an experiment; go on with --resume, or name another folder"
                )
            whole = self._read(settings)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("a", encoding="utf-8")
        self._file.truncate(whole)  # a line truncated by a crash
        if not whole:
            self._write({_HEADER: settings})

    def _read(self, settings: Mapping[str, Any]) -> int:
        """Read the existing journal; return the number of bytes in whole lines."""
        data = self.path.read_bytes()
        whole = data.rfind(b"\n") + 1
        lines = data[:whole].splitlines()
        try:
            rows = [json.loads(line) for line in lines]
            before = rows[0][_HEADER] if rows else settings
            self.done = {int(row["trial"]): row["result"] for row in rows[1:]}
        except (ValueError, KeyError, TypeError) as error:
            raise UsageError(f"{self.path} is no journal of an experiment: {error}") from None
        other = sorted(
            name for name in {*before, *settings} if before.get(name) != settings.get(name)
        )
        if other:
            was = ", ".join(f"{n} {before.get(n)!r} (now {settings.get(n)!r})" for n in other)
            raise UsageError(f"{self.path} is of an experiment with {was}; name another folder")
        return whole

    def append(self, trial: int, result: dict[str, Any]) -> None:
        """Append the result of a trial; it is on disk when this returns."""
        self._write({"trial": trial, "result": result})
        self.done[trial] = result

    def _write(self, row: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()
