"""The datasets of a server: a head that is written to, and versions that never change.

::

    DIR/blobs/                    bytes by digest, apart from those that the graph names
        <namespace>/<name>/
            dataset.json          owner, readers
            head.json             files of the head
            <number>.json         a version: files, parents, author, time, message
        views/<digest>/           folders of files for services to read, linked to the blobs
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

from rtask.errors import (
    ConflictError,
    ForbiddenError,
    UnknownTermError,
    UsageError,
    VersionConflictError,
    nearest,
)
from rtask.kb.commit.access import Access
from rtask.kb.durability.blobs import PREFIX, BlobStore, copy_blob, sync_folder
from rtask.services.datasets.tree import (
    Entry,
    Merged,
    Strategy,
    Tree,
    as_json,
    check_kind,
    check_path,
    difference,
    merge,
)
from rtask.services.datasets.version import HEAD, Version
from rtask.services.datasets.views import Views

__all__ = ["Datasets", "Version"]

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}/[A-Za-z][A-Za-z0-9_-]{0,63}")
_MAX_KNOWN = 64
_RESERVED = ("blobs", "views")
Contents = Callable[[], Mapping[str, bytes]]


class Datasets:
    """Datasets in a folder.

    Parameters
    ----------
    folder
        Where they are kept; None = in a temporary folder until :meth:`close`.

    Examples
    --------
    >>> datasets = Datasets(None)
    >>> datasets.create("lab/Parts")
    >>> datasets.put("lab/Parts", {"/cup.stl": b"solid"})
    >>> datasets.snapshot("lab/Parts", message="first").name
    'lab/Parts@1'
    >>> datasets.read("lab/Parts@1", "cup.stl")
    b'solid'
    >>> datasets.close()
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._temporary: str | None = None
        self._lock = threading.RLock()
        self._versions: dict[Path, tuple[tuple[int, int], Version]] = {}
        self._offered: dict[str, Contents] = {}

    @cached_property
    def _root(self) -> Path:
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            return self._folder
        self._temporary = tempfile.mkdtemp(prefix="rtask-datasets-")
        return Path(self._temporary)

    @cached_property
    def _blobs(self) -> BlobStore:
        return BlobStore(self._root / "blobs")

    @cached_property
    def _views(self) -> Views:
        return Views(self._root / "views")

    def offer(self, name: str, contents: Contents) -> None:
        """Add a dataset that comes with the product; it is stored when it is first asked for."""
        self._offered[name] = contents

    def create(
        self, name: str, access: Access | None = None, readers: list[str] | None = None
    ) -> None:
        """Create an empty dataset.

        Parameters
        ----------
        access
            Its owner, who may write to it.
        readers
            Names of the robots and people that may read it; None = all.

        Raises
        ------
        UsageError
            The name is not ``<namespace>/<name>``.
        ConflictError
            The name is taken.
        """
        if not _is_name(name):
            raise UsageError(f"dataset {name[:80]!r}: expected <namespace>/<name>")
        with self._lock:
            place = self._root / name
            if (place / "dataset.json").exists() or name in self._offered:
                raise ConflictError(f"dataset {name} exists already")
            place.mkdir(parents=True, exist_ok=True)
            owner = access.agent if access else None
            self._write(place / "head.json", {"files": {}, "parents": []})
            self._write(place / "dataset.json", {"owner": owner, "readers": readers})

    def fork(self, name: str, source: str, access: Access | None = None) -> None:
        """Create a dataset that goes on from a version of another; no bytes are copied.

        A fork of a private dataset has the same readers.
        """
        found = self.find(source, access)
        if not found.number:
            raise UsageError(f"{source}: fork a version; make one by a snapshot")
        readers = self._facts(found.dataset)["readers"]
        head = {"files": as_json(found.files), "parents": [found.name]}
        with self._lock:
            self.create(name, access, readers)
            self._write(self._root / name / "head.json", head)

    def names(self, access: Access | None = None) -> list[str]:
        """Return the names of the datasets that a caller may read, sorted."""
        stored = (
            f"{file.parent.parent.name}/{file.parent.name}"
            for file in self._root.glob("*/*/dataset.json")
        )
        every = sorted({*stored, *self._offered})
        return [name for name in every if name in self._offered or self._may_read(name, access)]

    def find(self, name: str, access: Access | None = None) -> Version:
        """Return a version: ``name@3``, ``name@head``, or the newest one, else the head.

        Raises
        ------
        UnknownTermError
            There is none; a private one looks the same to those who may not read it.
        """
        plain, _, wanted = name.partition("@")
        self._store_offered(plain)
        if not self._may_read(plain, access):
            raise UnknownTermError(f"no dataset {plain}{nearest(plain, self.names(access))}")
        numbers = self.numbers(plain)
        if wanted == HEAD or (not wanted and not numbers):
            return self._read(plain, 0)
        if not wanted:
            return self._read(plain, numbers[-1])
        number = next((one for one in numbers if str(one) == wanted), None)
        if number is None:
            known = ", ".join(map(str, numbers)) or "none"
            raise UnknownTermError(
                f"{plain} has no version {wanted[:20]}; there are {known}, and head"
            )
        return self._read(plain, number)

    def numbers(self, name: str) -> list[int]:
        """Return the numbers of a dataset's versions, the oldest first."""
        files = (self._root / name).glob("*.json")
        return sorted(int(file.stem) for file in files if file.stem.isdecimal())

    def read(self, name: str, path: str, access: Access | None = None) -> bytes:
        """Return the bytes of a file; errors as :meth:`file`."""
        return self.file(name, path, access)[1]

    def file(self, name: str, path: str, access: Access | None = None) -> tuple[Entry, bytes]:
        """Return a file: its entry and its bytes.

        Raises
        ------
        UnknownTermError
            The version has no such file.
        """
        version = self.find(name, access)
        entry = version.files.get(check_path(path))
        if entry is None:
            hint = nearest(path, list(version.files))
            raise UnknownTermError(f"{version.name} has no file {path}{hint}")
        return entry, self._blobs.read(PREFIX + entry.sha256)

    def put(
        self,
        name: str,
        contents: Mapping[str, bytes],
        access: Access | None = None,
        if_match: str | None = None,
    ) -> None:
        """Write files to the head, all of them or none.

        Parameters
        ----------
        contents
            Bytes by path.
        if_match
            Digest that the only file must have before; ``*`` = any, if it is there.

        Raises
        ------
        VersionConflictError
            Somebody else wrote the file first.
        """
        named = {check_path(path): data for path, data in contents.items()}
        self._check_write(name, access)  # nobody else's bytes reach the disk
        blobs = self._blobs.put_many(named.values())
        with self._changing(name, access) as files:
            for path, blob in zip(named, blobs, strict=True):
                before = files.get(path)
                if if_match is not None and not _matches(before, if_match):
                    raise VersionConflictError(f"{path} of {name} was changed in the meantime")
                check_kind(path, files)
                files[path] = Entry(blob.sha256, blob.size)

    def remove(self, name: str, paths: list[str], access: Access | None = None) -> None:
        """Remove files and folders from the head; the versions keep them.

        Raises
        ------
        UnknownTermError
            The head has no such file or folder.
        """
        with self._changing(name, access) as files:
            for path in map(check_path, paths):
                gone = [one for one in files if one == path or one.startswith(f"{path}/")]
                if not gone:
                    raise UnknownTermError(f"{name}@head has no file {path}")
                for one in gone:
                    del files[one]

    def snapshot(self, name: str, message: str = "", access: Access | None = None) -> Version:
        """Make the head a version; without changes since the last one, that is returned."""
        with self._lock:
            self._check_write(name, access)
            head = self._read(name, 0)
            numbers = self.numbers(name)
            if numbers and self._read(name, numbers[-1]).files == head.files:
                return self._read(name, numbers[-1])
            author = (access.agent if access else None) or ""
            number = numbers[-1] + 1 if numbers else 1
            made = Version(name, number, head.files, head.parents, author, message, time.time())
            self._write(self._root / name / f"{number}.json", made.stored())
            parents = {"files": as_json(head.files), "parents": [made.name]}
            self._write(self._root / name / "head.json", parents)
            return made

    def difference(
        self, before: str, after: str, access: Access | None = None
    ) -> dict[str, list[str]]:
        """Return the paths that differ between two versions."""
        return difference(self.find(before, access).files, self.find(after, access).files)

    def merge(
        self,
        name: str,
        source: str,
        rules: Mapping[str, Strategy] | None = None,
        message: str = "",
        access: Access | None = None,
    ) -> Version:
        """Merge a version into the head of a dataset, as a new version.

        Parameters
        ----------
        source
            A version of this dataset or of another with a common ancestor; without one, everything
            that differs is a conflict.
        rules
            See :func:`rtask.services.datasets.tree.merge`.

        Raises
        ------
        ConflictError
            ``conflicts`` lists what no rule decided; nothing was changed.
        """
        theirs = self.find(source, access)
        with self._lock:
            self._check_write(name, access)
            self.snapshot(name, f"before merging {theirs.name}", access)
            ours = self.find(name, access)
            base = self._ancestor(ours, theirs)
            merged = merge(base, ours.files, theirs.files, rules or {})
            self._refuse(merged, theirs)
            head = {"files": as_json(merged.files), "parents": [ours.name, theirs.name]}
            self._write(self._root / name / "head.json", head)
            return self.snapshot(name, message or f"merge {theirs.name}", access)

    def view(self, version: Version) -> Path:
        """Return a folder with the files of a version, to be read only."""
        return self._views.get(version.digest, lambda folder: self._fill(folder, version))

    def keep_view(self, place: Path, user: object) -> None:
        """Keep the folder of a version as long as the object that uses it lives."""
        self._views.keep(place, user)

    @contextmanager
    def scratch(self, name: str, access: Access | None = None) -> Iterator[Path]:
        """Yield a folder with the files of a version that may be changed, and is thrown away.

        Place, simulate, look, forget (Kehoe 2014, 6.2).
        """
        with self._views.scratch() as made:
            for path, entry in self.find(name, access).files.items():
                (made / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(self._blobs.path(PREFIX + entry.sha256), made / path)
            yield made

    def close(self) -> None:
        """Remove a temporary folder."""
        if self._temporary is not None:
            shutil.rmtree(self._temporary, ignore_errors=True)

    # Inside

    def _fill(self, folder: Path, version: Version) -> None:
        for path, entry in version.files.items():
            copy_blob(self._blobs.path(PREFIX + entry.sha256), folder / path)
            (folder / path).chmod(0o444)  # the file is the blob itself, which must not change

    def _store_offered(self, name: str) -> None:
        """Store a dataset that comes with the product, or its new contents as a version."""
        with self._lock:
            contents = self._offered.get(name)
            if contents is None:
                return
            files = contents()
            del self._offered[name]
            if not (self._root / name / "dataset.json").exists():
                self.create(name)
            with self._changing(name, None) as head:
                head.clear()
            self.put(name, files)
            self.snapshot(name, "comes with the product")

    def _ancestor(self, ours: Version, theirs: Version) -> Tree:
        """Return the files of the nearest common ancestor; none if there is none."""
        reached = {one.name for one in self._line(ours)}
        return next((one.files for one in self._line(theirs) if one.name in reached), {})

    def _line(self, version: Version) -> Iterator[Version]:
        """Yield a version and those that it was made from, the nearest first."""
        todo, seen = [version], {version.name}
        while todo:
            one = todo.pop(0)
            yield one
            for name in one.parents:
                dataset, _, number = name.partition("@")
                if name not in seen and (self._root / dataset / f"{number}.json").exists():
                    seen.add(name)
                    todo.append(self._read(dataset, int(number)))

    @staticmethod
    def _refuse(merged: Merged, source: Version) -> None:
        if not merged.conflicts:
            return
        first = merged.conflicts[0]
        raise ConflictError(
            f"merging {source.name}: {len(merged.conflicts)} conflicts, the first at "
            f"{first.path}: {first.kind}; give a rule, ours or theirs",
            conflicts=[{"path": one.path, "kind": one.kind} for one in merged.conflicts],
        )

    @contextmanager
    def _changing(self, name: str, access: Access | None) -> Iterator[dict[str, Entry]]:
        """Yield the files of the head, and store them if nothing is raised."""
        with self._lock:
            self._check_write(name, access)
            head = self._read(name, 0)
            files = dict(head.files)
            yield files
            stored = {"files": as_json(files), "parents": list(head.parents)}
            self._write(self._root / name / "head.json", stored)

    def _check_write(self, name: str, access: Access | None) -> None:
        self.find(f"{name}@{HEAD}", access)
        owner = self._facts(name)["owner"]
        if access is None or access.role in ("admin", "anonymous"):
            return
        if access.role == "reader" or access.agent != owner:
            raise ForbiddenError(f"{name} belongs to {owner or 'the server'}; fork it to change it")

    def _may_read(self, name: str, access: Access | None) -> bool:
        # A view of a dataset may hold a file called dataset.json.
        if not _is_name(name) or not (self._root / name / "dataset.json").exists():
            return False
        facts = self._facts(name)
        if facts["readers"] is None or access is None or access.role == "admin":
            return True
        return access.agent is not None and access.agent in (*facts["readers"], facts["owner"])

    def _facts(self, name: str) -> dict[str, Any]:
        found: dict[str, Any] = json.loads((self._root / name / "dataset.json").read_text("utf-8"))
        return found

    def _read(self, name: str, number: int) -> Version:
        """Return a stored version, from memory unless its file has changed."""
        file = self._root / name / f"{number or HEAD}.json"
        facts = file.stat()
        changed = facts.st_mtime_ns, facts.st_ino  # each write makes another file
        known = self._versions.get(file)
        if known is not None and known[0] == changed:
            return known[1]
        found = json.loads(file.read_text("utf-8"))
        version = Version.from_stored(name, number, found)
        with self._lock:
            if len(self._versions) >= _MAX_KNOWN:
                self._versions.clear()
            self._versions[file] = changed, version
        return version

    def _write(self, file: Path, value: Any) -> None:
        """Write a file so that it is there wholly or, after a crash, as it was."""
        temporary = file.with_suffix(".tmp")
        with temporary.open("w", encoding="utf-8") as out:
            json.dump(value, out)
            out.flush()
            os.fsync(out.fileno())
        temporary.replace(file)
        sync_folder(file.parent)
        self._versions.pop(file, None)


def _is_name(name: str) -> bool:
    return _NAME.fullmatch(name) is not None and name.partition("/")[0] not in _RESERVED


def _matches(before: Entry | None, wanted: str) -> bool:
    return before is not None and wanted.strip('"') in ("*", before.sha256)
