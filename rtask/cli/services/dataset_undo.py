"""Opposites of changes of a dataset's head: what to remove, or which version to restore from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtask.client.datasets import DatasetClient

__all__ = ["Head", "digests_of", "head_of"]


@dataclass(frozen=True)
class Head:
    """The head of a dataset before a change, and the newest version beside it.

    Parameters
    ----------
    name
        Of the dataset, without a version.
    files
        Digests of the head's files, by path.
    version
        Name of the newest version; None if there is none.
    versioned
        Digests of its files, by path.
    """

    name: str
    files: Mapping[str, str]
    version: str | None
    versioned: Mapping[str, str]

    def changed_by(self, digests: Mapping[str, str]) -> list[str]:
        """Return the paths whose contents differ from those to be written."""
        return [path for path, digest in digests.items() if self.files.get(path) != digest]

    def below(self, path: str) -> list[str]:
        """Return the paths of a file, or of the files of a folder."""
        name = path.strip("/")
        return [file for file in self.files if file == name or file.startswith(f"{name}/")]

    def opposite(self, changed: Iterable[str], named: Iterable[str] = ()) -> list[str] | None:
        """Return the arguments of the `rtask dataset` that undoes a change; None if nothing does.

        Parameters
        ----------
        changed
            Paths of the files that are written or removed.
        named
            Shorter names of all of them, such as their folder.
        """
        paths = list(changed)
        if self.version is not None and self.files == self.versioned:
            return ["restore", self.version]
        if all(path not in self.files for path in paths):
            return ["remove", self.name, *(named or paths)]
        if self.version is not None and all(
            self.files.get(path) == self.versioned.get(path) for path in paths
        ):
            return ["restore", self.version, *(named or paths)]
        return None

    def lost(self, changed: Iterable[str]) -> int:
        """Return how many files a change takes whose contents no version has."""
        held = set(self.versioned.values())
        return sum(path in self.files and self.files[path] not in held for path in changed)


def head_of(client: DatasetClient, name: str) -> Head:
    """Return the head of a dataset."""
    plain = name.partition("@")[0]
    head = client.describe(f"{plain}@head")
    numbers = head["versions"]
    newest: dict[str, Any] | None = client.describe(plain) if numbers else None
    return Head(
        plain,
        _digests(head),
        None if newest is None else newest["name"],
        {} if newest is None else _digests(newest),
    )


def digests_of(files: Mapping[str, Path]) -> dict[str, str]:
    """Return the SHA-256 of files, by their paths in the dataset."""
    return {path: hashlib.sha256(file.read_bytes()).hexdigest() for path, file in files.items()}


def _digests(described: Mapping[str, Any]) -> dict[str, str]:
    return {path: digest for path, (digest, _) in described["files"].items()}
