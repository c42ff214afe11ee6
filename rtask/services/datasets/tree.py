"""Contents of datasets, compared and merged (Kehoe 2014, 5.4: datasets that evolve)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from rtask.errors import ConflictError, UnknownTermError, UsageError

__all__ = [
    "Combine",
    "Conflict",
    "Entry",
    "Merged",
    "Strategy",
    "Tree",
    "as_json",
    "check_kind",
    "check_path",
    "difference",
    "digest_of",
    "from_json",
    "leave_out",
    "merge",
    "rule_for",
]

Strategy = Literal["fail", "ours", "theirs"]
_MAX_PATH = 400


@dataclass(frozen=True)
class Entry:
    """One file: digest and size of its bytes."""

    sha256: str
    size: int


Tree = Mapping[str, Entry]
"""Files by their paths, without a slash in front."""


@dataclass(frozen=True)
class Conflict:
    """A place at which two versions cannot both be kept.

    Parameters
    ----------
    path
        Of the file.
    kind
        ``both_changed``, ``changed_and_deleted``, ``file_against_folder`` or
        ``one_key_two_values``.
    key
        Of the record, as JSON, where the file holds records.
    """

    path: str
    kind: str
    key: str = ""

    @property
    def place(self) -> str:
        """Path with the key."""
        return f"{self.path}, record {self.key}" if self.key else self.path

    def facts(self) -> dict[str, Any]:
        """Return what callers see of it, as JSON."""
        facts = {"path": self.path, "kind": self.kind}
        return {**facts, "key": json.loads(self.key)} if self.key else facts


@dataclass(frozen=True)
class Merged:
    """The result of a merge; ``conflicts`` lists what no strategy decided."""

    files: Tree
    conflicts: tuple[Conflict, ...]


Combine = Callable[[str, Entry | None, Entry, Entry], tuple[Entry, list[Conflict]] | None]
"""Merges a file that both sides changed, from path, ancestor, ours and theirs; or returns none."""


def check_path(path: str) -> str:
    """Return a path without a slash in front.

    Raises
    ------
    UsageError
        It is empty, too long, or leads out of the dataset.

    Examples
    --------
    >>> check_path("/models/arm.urdf")
    'models/arm.urdf'
    >>> check_path("../secret")
    Traceback (most recent call last):
    rtask.errors.UsageError: path '../secret': expected names separated by slashes
    """
    parts = path.removeprefix("/").split("/")
    is_wrong = any(part in ("", ".", "..") or "\0" in part or "\\" in part for part in parts)
    if is_wrong or len(path) > _MAX_PATH:
        raise UsageError(f"path {path[:80]!r}: expected names separated by slashes", field="path")
    return "/".join(parts)


def digest_of(tree: Tree) -> str:
    """Return a digest of paths and contents."""
    lines = (f"{path}\0{entry.sha256}\n" for path, entry in sorted(tree.items()))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def difference(before: Tree, after: Tree) -> dict[str, list[str]]:
    """Return the paths that were added, removed and changed, sorted.

    Examples
    --------
    >>> a, b = Entry("aa", 1), Entry("bb", 1)
    >>> difference({"x": a, "y": a}, {"y": b, "z": b})
    {'added': ['z'], 'removed': ['x'], 'changed': ['y']}
    """
    return {
        "added": sorted(after.keys() - before.keys()),
        "removed": sorted(before.keys() - after.keys()),
        "changed": sorted(p for p in before.keys() & after.keys() if before[p] != after[p]),
    }


def merge(
    base: Tree,
    ours: Tree,
    theirs: Tree,
    rules: Mapping[str, Strategy],
    combine: Combine | None = None,
) -> Merged:
    """Merge two trees with their common ancestor.

    Parameters
    ----------
    rules
        What to do with conflicts, by the path of a file or of a folder that holds it; the longest
        one that fits counts. ``""`` is for all.
    combine
        Is asked first about each file that both sides changed.

    Examples
    --------
    >>> old, new, other = Entry("00", 1), Entry("11", 1), Entry("22", 1)
    >>> merge({"a": old}, {"a": new}, {"a": old, "b": other}, {}).files
    {'a': Entry(sha256='11', size=1), 'b': Entry(sha256='22', size=1)}
    >>> merge({"a": old}, {"a": new}, {"a": other}, {}).conflicts[0].facts()
    {'path': 'a', 'kind': 'both_changed'}
    """
    files: dict[str, Entry] = {}
    conflicts: list[Conflict] = []
    for path in sorted({*base, *ours, *theirs}):
        was, mine, other = base.get(path), ours.get(path), theirs.get(path)
        if mine == other or other == was:
            chosen = mine
        elif mine == was:
            chosen = other
        elif combine and mine and other and (joined := combine(path, was, mine, other)):
            chosen = joined[0]
            conflicts += joined[1]
        else:
            kind = "changed_and_deleted" if mine is None or other is None else "both_changed"
            rule = rule_for(path, rules)
            if rule == "fail":
                conflicts.append(Conflict(path, kind))
            chosen = other if rule == "theirs" else mine
        if chosen is not None:
            files[path] = chosen
    return _without_clashes(files, conflicts, ours, rules)


def _without_clashes(
    files: dict[str, Entry], conflicts: list[Conflict], ours: Tree, rules: Mapping[str, Strategy]
) -> Merged:
    """Settle names that are a file on one side and a folder on the other."""
    remaining = dict(files)
    for path in files:
        inside = [other for other in files if other.startswith(f"{path}/")]
        if not inside:
            continue
        rule = rule_for(path, rules)
        if rule == "fail":
            conflicts.append(Conflict(path, "file_against_folder"))
        file_stays = (path in ours) == (rule != "theirs")
        for gone in inside if file_stays else [path]:
            remaining.pop(gone, None)
    return Merged(remaining, tuple(conflicts))


def rule_for(path: str, rules: Mapping[str, Strategy]) -> Strategy:
    """Return the rule of the narrowest place that a path lies in; ``fail`` if there is none.

    Examples
    --------
    >>> rule_for("parts/cup.stl", {"": "ours", "parts": "theirs", "parts/c": "ours"})
    'theirs'
    >>> rule_for("tries.jsonl#t17", {"tries.jsonl#t1": "theirs"})
    'fail'
    """
    fitting = [place for place in rules if _lies_in(path, place.removeprefix("/"))]
    return rules[max(fitting, key=len)] if fitting else "fail"


def _lies_in(path: str, place: str) -> bool:
    """Tell whether a file, or a record of one, is at a place or in it."""
    if place in ("", path) or path.startswith(f"{place}#"):
        return True
    is_record = "#" in place and not place.endswith("/")
    return not is_record and path.startswith(f"{place.rstrip('/')}/")


def as_json(tree: Tree) -> dict[str, Any]:
    """Return a tree as JSON."""
    return {path: [entry.sha256, entry.size] for path, entry in sorted(tree.items())}


def from_json(stored: Mapping[str, Any]) -> dict[str, Entry]:
    """Return the tree that :func:`as_json` wrote."""
    return {path: Entry(sha, size) for path, (sha, size) in stored.items()}


def check_kind(path: str, files: Mapping[str, Entry]) -> None:
    """Refuse a file where a folder is, and a folder where a file is."""
    parts = path.split("/")
    above = ["/".join(parts[:count]) for count in range(1, len(parts))]
    if any(path_ in files for path_ in above) or any(
        path_.startswith(f"{path}/") for path_ in files
    ):
        raise ConflictError(f"{path}: a folder and a file cannot have one name")


def leave_out(files: dict[str, Entry], paths: list[str], name: str) -> None:
    """Remove files, and whole folders, from those of a head.

    Raises
    ------
    UnknownTermError
        There is no such file or folder in the head of the dataset of this name.
    """
    for path in map(check_path, paths):
        gone = [path_ for path_ in files if path_ == path or path_.startswith(f"{path}/")]
        if not gone:
            raise UnknownTermError(f"{name}@head has no file {path}")
        for path_ in gone:
            del files[path_]
