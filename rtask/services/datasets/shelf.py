"""The files in which a server keeps what its datasets are: heads, versions, owners and readers."""

from __future__ import annotations

import json
import os
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rtask.kb.durability.blobs import sync_folder
from rtask.services.datasets.tree import Tree, as_json
from rtask.services.datasets.version import HEAD, Version

__all__ = ["Shelf", "is_name"]

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}/[A-Za-z][A-Za-z0-9_-]{0,63}")
_RESERVED = ("blobs", "views")
_MAX_CACHED = 64
_FACTS = "dataset.json"


class Shelf:
    """JSON files in a folder; each is written so that it is there wholly or as it was.

    Parameters
    ----------
    root
        The folder.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._lock = threading.Lock()
        self._versions: dict[Path, tuple[tuple[int, int], Version]] = {}

    def holds(self, name: str) -> bool:
        """Tell whether there is a dataset of a name."""
        # A view of a dataset may hold a file called dataset.json.
        return is_name(name) and (self._root / name / _FACTS).exists()

    def names(self) -> list[str]:
        """Return the names of all datasets."""
        files = self._root.glob(f"*/*/{_FACTS}")
        return [f"{file.parent.parent.name}/{file.parent.name}" for file in files]

    def facts(self, name: str) -> dict[str, Any]:
        """Return owner, readers and key of a dataset."""
        facts: dict[str, Any] = json.loads((self._root / name / _FACTS).read_text("utf-8"))
        return facts

    def create(self, name: str, facts: dict[str, Any]) -> None:
        """Make an empty dataset."""
        (self._root / name).mkdir(parents=True, exist_ok=True)
        self.write_head(name, {}, ())
        self._write(self._root / name / _FACTS, facts)

    def numbers(self, name: str) -> list[int]:
        """Return the numbers of a dataset's versions, the oldest first."""
        files = (self._root / name).glob("*.json")
        return sorted(int(file.stem) for file in files if file.stem.isdecimal())

    def read(self, name: str, number: int) -> Version:
        """Return a version, 0 = the head; from memory unless its file has changed."""
        file = self._root / name / f"{number or HEAD}.json"
        facts = file.stat()
        changed = facts.st_mtime_ns, facts.st_ino  # each write makes another file
        cached = self._versions.get(file)
        if cached is not None and cached[0] == changed:
            return cached[1]
        version = Version.from_stored(name, number, json.loads(file.read_text("utf-8")))
        with self._lock:
            if len(self._versions) >= _MAX_CACHED:
                self._versions.clear()
            self._versions[file] = changed, version
        return version

    def write(self, version: Version) -> None:
        """Write a version."""
        self._write(self._root / version.dataset / f"{version.number}.json", version.stored())

    def write_head(self, name: str, files: Tree, parents: tuple[str, ...]) -> None:
        """Write the head of a dataset."""
        head = {"files": as_json(files), "parents": list(parents)}
        self._write(self._root / name / f"{HEAD}.json", head)

    def ancestor(self, ours: Version, theirs: Version) -> Tree:
        """Return the files of the nearest common ancestor; none if there is none."""
        reached = {version.name for version in self._line(ours)}
        return next(
            (version.files for version in self._line(theirs) if version.name in reached), {}
        )

    def _line(self, version: Version) -> Iterator[Version]:
        """Yield a version and those that it was made from, the nearest first."""
        todo, seen = [version], {version.name}
        while todo:
            reached = todo.pop(0)
            yield reached
            for name in reached.parents:
                dataset, _, number = name.partition("@")
                if name not in seen and (self._root / dataset / f"{number}.json").exists():
                    seen.add(name)
                    todo.append(self.read(dataset, int(number)))

    def _write(self, file: Path, value: Any) -> None:
        temporary = file.with_suffix(".tmp")
        with temporary.open("w", encoding="utf-8") as out:
            json.dump(value, out)
            out.flush()
            os.fsync(out.fileno())
        temporary.replace(file)
        sync_folder(file.parent)
        self._versions.pop(file, None)


def is_name(name: str) -> bool:
    """Tell whether a text is a name that datasets may have.

    Examples
    --------
    >>> [is_name(one) for one in ("robots/NAO", "robots", "blobs/NAO", "../NAO")]
    [True, False, False, False]
    """
    return _NAME.fullmatch(name) is not None and name.partition("/")[0] not in _RESERVED
