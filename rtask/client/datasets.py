"""Datasets of a server, over HTTP."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

from rtask.client.http import HttpClient
from rtask.services.outward.frames import pack

__all__ = ["DatasetClient"]

_PART_BYTES, _PART_FILES = 4 << 20, 2000


class DatasetClient(HttpClient):
    """Reads and writes the datasets of a server."""

    def names(self) -> list[str]:
        """Return the names of the datasets that may be read."""
        names: list[str] = self._send("GET", "/datasets").json()["datasets"]
        return names

    def create(
        self, name: str, fork_of: str | None = None, private: bool = False, key: str = ""
    ) -> None:
        """Create a dataset, empty or as a fork of a version; a private one is its owner's alone.

        Parameters
        ----------
        key
            Field that tells the records of its ``.jsonl`` files apart, for merges.
        """
        body: dict[str, Any] = {"readers": []} if private else {}
        if key:
            body["key"] = key
        if fork_of:
            body["fork_of"] = fork_of
        self._send("PUT", _place(name), json=body)

    def describe(self, name: str) -> dict[str, Any]:
        """Return a version or the head with its files."""
        description: dict[str, Any] = self._send("GET", _place(name)).json()
        return description

    def get(self, name: str, path: str) -> bytes:
        """Return the bytes of a file."""
        return bytes(self._send("GET", _file(name, path)).content)

    def put(self, name: str, path: str, data: bytes) -> None:
        """Write a file to the head."""
        kind = {"Content-Type": "application/octet-stream"}
        self._send("PUT", _file(name, path), content=data, headers=kind)

    def put_many(self, name: str, files: Mapping[str, Path]) -> int:
        """Write files to the head by their paths there; return how many were not there already.

        What the head holds with the same contents is not sent again. Files travel many at a time;
        each such part is stored wholly or not at all.
        """
        stored_files = self.describe(f"{name}@head")["files"]
        part: dict[str, bytes] = {}
        size = sent = 0
        for path, file in files.items():
            data = file.read_bytes()
            if path in stored_files and stored_files[path][0] == hashlib.sha256(data).hexdigest():
                continue
            sent += 1
            if len(data) > _PART_BYTES:
                self.put(name, path, data)
                continue
            if part and (size + len(data) > _PART_BYTES or len(part) >= _PART_FILES):
                self._put_part(name, part)
                part, size = {}, 0
            part[path] = data
            size += len(data)
        if part:
            self._put_part(name, part)
        return sent

    def _put_part(self, name: str, part: dict[str, bytes]) -> None:
        kind = {"Content-Type": "application/cbor"}
        self._send("POST", f"{_place(name)}/files", content=pack(part), headers=kind)

    def remove(self, name: str, path: str) -> None:
        """Remove a file or a folder from the head."""
        self._send("DELETE", _file(name, path))

    def snapshot(self, name: str, message: str = "") -> dict[str, Any]:
        """Make the head a version and return it."""
        place = f"{_place(name)}/snapshot"
        snapshot: dict[str, Any] = self._send("POST", place, json={"message": message}).json()
        return snapshot

    def prune(self, name: str, paths: list[str], where: Mapping[str, Any]) -> dict[str, Any]:
        """Make a version without some files, and the records with some values; return it."""
        body = {"paths": paths, "where": dict(where)}
        pruned: dict[str, Any] = self._send("POST", f"{_place(name)}/prune", json=body).json()
        return pruned

    def difference(self, name: str, before: str, after: str) -> dict[str, list[str]]:
        """Return the paths that differ between two versions."""
        place = f"{_place(name)}/diff"
        given = {"from": before, "to": after}
        differences: dict[str, list[str]] = self._send("GET", place, params=given).json()
        return differences

    def merge(self, name: str, source: str, rules: dict[str, str]) -> dict[str, Any]:
        """Merge a version into the head and return the version that comes of it."""
        body = {"source": source, "rules": rules}
        merged: dict[str, Any] = self._send("POST", f"{_place(name)}/merge", json=body).json()
        return merged


def _place(name: str) -> str:
    return f"/datasets/{quote(name, safe='/@')}"


def _file(name: str, path: str) -> str:
    return f"{_place(name)}/files/{quote(path.removeprefix('/'))}"
