"""A version of a dataset: paths with the digests of their contents, and where it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from rtask.services.datasets.tree import Tree, as_json, digest_of, from_json

__all__ = ["HEAD", "Doubt", "Version"]

HEAD = "head"
Doubt = dict[str, Any]
"""A number that a merge brought: path, key of the record, field, value."""


@dataclass(frozen=True)
class Version:
    """One version of a dataset, or its head.

    Parameters
    ----------
    dataset
        ``<namespace>/<name>``.
    number
        From 1; 0 is the head.
    parents
        The versions that it was made from, ``<namespace>/<name>@<number>``.
    time
        When it was made, s since the epoch.
    doubts
        Numbers in records that the merge behind it brought and that are far from all others.
    """

    dataset: str
    number: int
    files: Tree
    parents: tuple[str, ...] = ()
    author: str = ""
    message: str = ""
    time: float = 0.0
    doubts: tuple[Doubt, ...] = ()

    @property
    def name(self) -> str:
        """Name with the number, ``robots/NAO@3`` or ``robots/NAO@head``."""
        return f"{self.dataset}@{self.number or HEAD}"

    @cached_property
    def digest(self) -> str:
        """Digest of paths and contents."""
        return digest_of(self.files)

    def facts(self) -> dict[str, Any]:
        """Return what callers see of it, as JSON."""
        return {
            "name": self.name, "version": self.number or HEAD, "parents": list(self.parents),
            "author": self.author, "message": self.message, "time": self.time,
            "digest": self.digest, "bytes": sum(entry.size for entry in self.files.values()),
            "files": as_json(self.files), "doubts": list(self.doubts),
        }  # fmt: skip

    def stored(self) -> dict[str, Any]:
        """Return what its file holds."""
        return {
            "files": as_json(self.files),
            "parents": list(self.parents),
            "author": self.author,
            "message": self.message,
            "time": self.time,
            "doubts": list(self.doubts),
        }

    @classmethod
    def from_stored(cls, dataset: str, number: int, stored: dict[str, Any]) -> Version:
        """Return the version that a file holds; a head has neither author nor message nor time."""
        return cls(
            dataset, number, from_json(stored["files"]), tuple(stored["parents"]),
            stored.get("author", ""), stored.get("message", ""), stored.get("time", 0.0),
            tuple(stored.get("doubts", ())),
        )  # fmt: skip
