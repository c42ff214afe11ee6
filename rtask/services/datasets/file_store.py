"""Bytes of the files of datasets, and folders of files made from them."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

from rtask.kb.durability.blobs import PREFIX, BlobStore, copy_blob
from rtask.services.datasets.tree import Entry
from rtask.services.datasets.version import Version
from rtask.services.datasets.views import Views

__all__ = ["FileStore"]


class FileStore:
    """Bytes by digest below a folder, and the folders of versions that link to them.

    Parameters
    ----------
    root
        Holds ``blobs/`` and ``views/``, which are made when they are first used.
    """

    def __init__(self, root: Path) -> None:
        self._root = root

    @cached_property
    def _blobs(self) -> BlobStore:
        return BlobStore(self._root / "blobs")

    @cached_property
    def _views(self) -> Views:
        return Views(self._root / "views")

    def holds(self, entry: Entry) -> bool:
        """Whether the bytes of a file are here."""
        return self._blobs.has(PREFIX + entry.sha256)

    def read(self, entry: Entry) -> bytes:
        """Return the bytes of a file."""
        return self._blobs.read(PREFIX + entry.sha256)

    def store(self, data: bytes) -> Entry:
        """Store bytes, and return the entry of a file that holds them."""
        (entry,) = self.store_all([data])
        return entry

    def store_all(self, contents: Iterable[bytes]) -> list[Entry]:
        """Store the bytes of several files, and return their entries in order."""
        return [Entry(blob.sha256, blob.size) for blob in self._blobs.put_many(contents)]

    def view(self, version: Version) -> Path:
        """Return a folder with the files of a version, to be read only."""
        return self._views.get(version.digest, lambda folder: self._fill(folder, version))

    def keep_view(self, place: Path, user: object) -> None:
        """Keep the folder of a version as long as the object that uses it lives."""
        self._views.keep(place, user)

    @contextmanager
    def scratch(self, files: Mapping[str, Entry]) -> Iterator[Path]:
        """Yield a folder with copies of files, which is thrown away."""
        with self._views.scratch() as made:
            for path, entry in files.items():
                (made / path).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(self._blobs.path(PREFIX + entry.sha256), made / path)
            yield made

    def _fill(self, folder: Path, version: Version) -> None:
        for path, entry in version.files.items():
            copy_blob(self._blobs.path(PREFIX + entry.sha256), folder / path)
            (folder / path).chmod(0o444)  # the file is the blob itself, which must not change
