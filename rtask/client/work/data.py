"""Datasets of a server as a worker reads them: files are fetched once and kept by their digest."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from pathlib import Path

from rtask.client.datasets import DatasetClient
from rtask.errors import VersionConflictError
from rtask.kb.commit.access import Access
from rtask.services.datasets.store import Datasets
from rtask.services.datasets.version import Version

__all__ = ["ServerDatasets"]


class ServerDatasets(Datasets):
    """The datasets of a server, with their files in a folder of this machine.

    Parameters
    ----------
    server
        Address of the server.
    token
        Of the worker, which must be allowed to read the datasets.
    cache
        Folder that workers of this machine may share; None = a temporary one.
    """

    def __init__(self, server: str, token: str | None, cache: Path | None) -> None:
        super().__init__(cache)
        self._client = DatasetClient(server, token)
        self._versions: dict[str, Version] = {}
        self._written: dict[int, dict[str, dict[str, bytes]]] = {}
        self._writing = threading.Lock()

    def find(self, name: str, access: Access | None = None) -> Version:
        """Return a version, as the server tells it; errors as those of the server."""
        version = self._versions.get(name)
        if version is None:
            description = self._client.describe(name)
            dataset, _, number = description["name"].partition("@")
            numbered = int(number) if number.isdecimal() else 0
            version = Version.from_stored(dataset, numbered, description)
            if numbered:  # what has a number never changes
                self._versions[version.name] = version
        return version

    def view(self, version: Version) -> Path:
        """Return a folder with the files of a version, fetched from the server where missing.

        Raises
        ------
        VersionConflictError
            The head was written to in the meantime.
        """
        for path, entry in version.files.items():
            if self._files.holds(entry):
                continue
            if self._files.store(self._client.get(version.name, path)).sha256 != entry.sha256:
                raise VersionConflictError(f"{path} of {version.name} was changed meanwhile")
        return super().view(version)

    def put(
        self,
        name: str,
        contents: Mapping[str, bytes],
        access: Access | None = None,
        if_match: str | None = None,
    ) -> None:
        """Keep what a call wrote until its answer takes it to the server."""
        with self._writing:
            self._written.setdefault(id(access), {})[name] = dict(contents)

    def put_together(
        self, contents: Mapping[str, Mapping[str, bytes]], access: Access | None = None
    ) -> None:
        """Keep what a call wrote to several datasets until its answer takes it to the server."""
        for name, files in contents.items():
            self.put(name, files, access)

    def take_written(self, access: Access) -> dict[str, dict[str, bytes]]:
        """Return what the call with these rights wrote, by dataset and path, and forget it."""
        with self._writing:
            return self._written.pop(id(access), {})

    def close(self) -> None:
        """Remove a temporary folder."""
        self._client.close()
        super().close()
