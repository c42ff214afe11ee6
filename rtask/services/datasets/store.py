"""The datasets of a server: a head that is written to, and versions that never change.

::

    DIR/blobs/                    bytes by digest, apart from those that the graph names
        <namespace>/<name>/
            dataset.json          owner, readers, key of its records
            head.json             files of the head
            <number>.json         a version: files, parents, author, time, message
        views/<digest>/           folders of files for services to read, linked to the blobs
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
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
from rtask.scratch import ScratchFolder
from rtask.services.datasets.file_store import FileStore
from rtask.services.datasets.merging import Merge
from rtask.services.datasets.records import ENDING, read_records, without
from rtask.services.datasets.rights import check_may_write, may_read
from rtask.services.datasets.shelf import Shelf, is_name
from rtask.services.datasets.tree import (
    Entry,
    Strategy,
    check_kind,
    check_path,
    difference,
    leave_out,
)
from rtask.services.datasets.version import HEAD, Doubt, Version

__all__ = ["Datasets", "Version"]

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
        self._temporary: ScratchFolder | None = None
        self._lock = threading.RLock()
        self._offered: dict[str, Contents] = {}

    @cached_property
    def _root(self) -> Path:
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            return self._folder
        self._temporary = ScratchFolder("datasets")
        return self._temporary.path

    @cached_property
    def _shelf(self) -> Shelf:
        return Shelf(self._root)

    @cached_property
    def _files(self) -> FileStore:
        return FileStore(self._root)

    def offer(self, name: str, contents: Contents) -> None:
        """Add a dataset that comes with the product; it is stored when it is first asked for."""
        self._offered[name] = contents

    def create(
        self,
        name: str,
        access: Access | None = None,
        readers: list[str] | None = None,
        key: str = "",
    ) -> None:
        """Create an empty dataset.

        Parameters
        ----------
        access
            Its owner, who may write to it.
        readers
            Names of the robots and people that may read it; None = all.
        key
            Field that tells the records in its ``.jsonl`` files apart, which are then merged
            record by record; empty = its files are only bytes.

        Raises
        ------
        UsageError
            The name is not ``<namespace>/<name>``.
        ConflictError
            The name is taken, or the dataset would be private in a namespace that others use.
        ForbiddenError
            The namespace has private datasets that the caller may not read. This is so for every
            name in it, so that it does not tell which names are taken.
        """
        if not is_name(name):
            raise UsageError(f"dataset {name[:80]!r}: expected <namespace>/<name>")
        with self._lock:
            self._check_namespace(name, access, is_private=readers is not None)
            if self._shelf.holds(name) or name in self._offered:
                raise ConflictError(f"dataset {name} exists already")
            owner = access.agent if access else None
            self._shelf.create(name, {"owner": owner, "readers": readers, "key": key})

    def _check_namespace(self, name: str, access: Access | None, *, is_private: bool) -> None:
        if access is None or access.role == "admin":
            return
        namespace = name.partition("/")[0]
        start = f"{namespace}/"
        stored = [other for other in self._shelf.names() if other.startswith(start)]
        if not all(self._may_read(other, access) for other in stored):
            raise ForbiddenError(
                f"the namespace {namespace} belongs to somebody else; use one of your own"
            )
        is_shared = any(offered.startswith(start) for offered in self._offered) or any(
            self._shelf.facts(other)["owner"] != access.agent for other in stored
        )
        if is_private and is_shared:
            raise ConflictError(
                f"the namespace {namespace} has datasets of others, so {name} cannot be private; "
                "use a namespace of your own"
            )

    def fork(self, name: str, source: str, access: Access | None = None) -> None:
        """Create a dataset that goes on from a version of another; no bytes are copied.

        A fork of a private dataset has the same readers, and one of records the same key.
        """
        version = self.find(source, access)
        if not version.number:
            raise UsageError(f"{source}: fork a version; make one by a snapshot")
        facts = self._shelf.facts(version.dataset)
        with self._lock:
            self.create(name, access, facts["readers"], self.key(version.dataset))
            self._shelf.write_head(name, version.files, (version.name,))

    def key(self, name: str) -> str:
        """Return the field that tells the records of a dataset apart; empty if it has none."""
        key: str = self._shelf.facts(name).get("key", "")
        return key

    def names(self, access: Access | None = None) -> list[str]:
        """Return the names of the datasets that a caller may read, sorted."""
        every = sorted({*self._shelf.names(), *self._offered})
        return [name for name in every if name in self._offered or self._may_read(name, access)]

    def find(self, name: str, access: Access | None = None) -> Version:
        """Return a version: ``name@3``, ``name@head``, or the newest one, else the head.

        Raises
        ------
        UnknownTermError
            There is none; a private one looks the same to those who may not read it.
        """
        plain, _, requested = name.partition("@")
        self._store_offered(plain)
        if not self._may_read(plain, access):
            raise UnknownTermError(f"no dataset {plain}{nearest(plain, self.names(access))}")
        numbers = self.numbers(plain)
        if requested == HEAD or (not requested and not numbers):
            return self._shelf.read(plain, 0)
        if not requested:
            return self._shelf.read(plain, numbers[-1])
        number = next((candidate for candidate in numbers if str(candidate) == requested), None)
        if number is None:
            available = ", ".join(map(str, numbers)) or "none"
            raise UnknownTermError(
                f"{plain} has no version {requested[:20]}; there are {available}, and head"
            )
        return self._shelf.read(plain, number)

    def numbers(self, name: str) -> list[int]:
        """Return the numbers of a dataset's versions, the oldest first."""
        return self._shelf.numbers(name)

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
        return entry, self._files.read(entry)

    def put(
        self,
        name: str,
        contents: Mapping[str, bytes],
        access: Access | None = None,
        if_match: str | None = None,
    ) -> None:
        """Write files to the head of a dataset, all of them or none.

        Parameters
        ----------
        contents
            Bytes by path.
        if_match
            Digest that the only file must have before; ``*`` = any, if it is there.

        Raises
        ------
        UsageError
            A file of records does not hold any.
        VersionConflictError
            Somebody else wrote the file first.
        """
        entries = self._store_version(name, contents, access)
        with self._changing(name, access) as files:
            for path, entry in entries.items():
                before = files.get(path)
                if if_match is not None and not _matches(before, if_match):
                    raise VersionConflictError(f"{path} of {name} was changed in the meantime")
                check_kind(path, files)
                files[path] = entry

    def put_together(
        self, contents: Mapping[str, Mapping[str, bytes]], access: Access | None = None
    ) -> None:
        """Write files to the heads of several datasets; if one is refused, none is written.

        Parameters
        ----------
        contents
            Bytes by dataset and path.

        Raises
        ------
        UsageError
            As :meth:`put`.
        """
        entries = {
            name: self._store_version(name, files, access) for name, files in contents.items()
        }
        with ExitStack() as heads:
            for name, stored_files in entries.items():
                files = heads.enter_context(self._changing(name, access))
                for path, entry in stored_files.items():
                    check_kind(path, files)
                    files[path] = entry

    def _store_version(
        self, name: str, contents: Mapping[str, bytes], access: Access | None
    ) -> dict[str, Entry]:
        """Store contents for the head of a dataset, and return their entries by path."""
        named = {check_path(path): data for path, data in contents.items()}
        self._check_write(name, access)  # nobody else's bytes reach the disk
        if key := self.key(name):
            for path, data in named.items():
                if path.endswith(ENDING):
                    read_records(data, key, path)
        return dict(zip(named, self._files.store_all(named.values()), strict=True))

    def remove(self, name: str, paths: list[str], access: Access | None = None) -> None:
        """Remove files and folders from the head; the versions keep them.

        Raises
        ------
        UnknownTermError
            The head has no such file or folder.
        """
        with self._changing(name, access) as files:
            leave_out(files, paths, name)

    def prune(
        self,
        name: str,
        paths: list[str],
        where: Mapping[str, Any] | None = None,
        message: str = "",
        access: Access | None = None,
    ) -> Version:
        """Make a version without some files, and without some records; older ones keep them.

        Parameters
        ----------
        paths
            Files and folders to leave out.
        where
            Values of fields; the records that have all of them are left out, such as those of one
            robot. None = no record is.

        Raises
        ------
        UsageError
            Records are to be left out of a dataset without a key.
        UnknownTermError
            There is no such file, folder or record.
        """
        with self._lock:
            with self._changing(name, access) as files:
                leave_out(files, paths, name)
                if where:
                    files.update(self._without(name, files, where))
            return self.snapshot(name, message or "prune", access)

    def _without(
        self, name: str, files: Mapping[str, Entry], where: Mapping[str, Any]
    ) -> dict[str, Entry]:
        """Return the files of records that lose some, without these."""
        if not (key := self.key(name)):
            raise UsageError(f"{name} has no key, so its files are no records")
        changed = {}
        for path, entry in files.items():
            if path.endswith(ENDING):
                rest = without(self._files.read(entry), key, path, where)
                if rest is not None:
                    changed[path] = self._files.store(rest)
        if not changed:
            raise UnknownTermError(f"{name}@head has no record with {dict(where)}")
        return changed

    def snapshot(self, name: str, message: str = "", access: Access | None = None) -> Version:
        """Make the head a version; without changes since the last one, that is returned."""
        return self._snapshot(name, message, access)

    def _snapshot(
        self, name: str, message: str, access: Access | None, doubts: tuple[Doubt, ...] = ()
    ) -> Version:
        with self._lock:
            self._check_write(name, access)
            head = self._shelf.read(name, 0)
            numbers = self.numbers(name)
            if numbers and self._shelf.read(name, numbers[-1]).files == head.files:
                return self._shelf.read(name, numbers[-1])
            author = (access.agent if access else None) or ""
            number = numbers[-1] + 1 if numbers else 1
            made = Version(
                name, number, head.files, head.parents, author, message, time.time(), doubts
            )
            self._shelf.write(made)
            self._shelf.write_head(name, head.files, (made.name,))
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
            See :class:`rtask.services.datasets.merging.Merge`.

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
            merge = Merge(rules or {}, self.key(name), self._files.read, self._files.store)
            try:
                files = merge.files(self._shelf.ancestor(ours, theirs), ours.files, theirs.files)
            except ConflictError as error:
                raise ConflictError(f"merging {theirs.name}: {error}", **error.details) from None
            self._shelf.write_head(name, files, (ours.name, theirs.name))
            doubts = tuple(merge.doubts(ours.files, files))
            return self._snapshot(name, message or f"merge {theirs.name}", access, doubts)

    def view(self, version: Version) -> Path:
        """Return a folder with the files of a version, to be read only."""
        return self._files.view(version)

    def keep_view(self, place: Path, user: object) -> None:
        """Keep the folder of a version as long as the object that uses it lives."""
        self._files.keep_view(place, user)

    @contextmanager
    def scratch(self, name: str, access: Access | None = None) -> Iterator[Path]:
        """Yield a folder with the files of a version that may be changed, and is thrown away.

        Place, simulate, look, forget (Kehoe 2014, 6.2).
        """
        with self._files.scratch(self.find(name, access).files) as made:
            yield made

    def close(self) -> None:
        """Remove a temporary folder."""
        if self._temporary is not None:
            self._temporary.close()

    # Inside

    def _store_offered(self, name: str) -> None:
        """Store a dataset that comes with the product, or its new contents as a version."""
        with self._lock:
            contents = self._offered.get(name)
            if contents is None:
                return
            files = contents()
            del self._offered[name]
            if not self._shelf.holds(name):
                self.create(name)
            with self._changing(name, None) as head:
                head.clear()
            self.put(name, files)
            self.snapshot(name, "comes with RTASK")

    @contextmanager
    def _changing(self, name: str, access: Access | None) -> Iterator[dict[str, Entry]]:
        """Yield the files of the head, and store them if nothing is raised."""
        with self._lock:
            self._check_write(name, access)
            head = self._shelf.read(name, 0)
            files = dict(head.files)
            yield files
            self._shelf.write_head(name, files, head.parents)

    def _check_write(self, name: str, access: Access | None) -> None:
        self.find(f"{name}@{HEAD}", access)
        check_may_write(name, self._shelf.facts(name), access)

    def _may_read(self, name: str, access: Access | None) -> bool:
        return self._shelf.holds(name) and may_read(self._shelf.facts(name), access)


def _matches(before: Entry | None, condition: str) -> bool:
    return before is not None and condition.strip('"') in ("*", before.sha256)
