"""Merge of two versions of a dataset: files by path, and files of records by key."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from rtask.errors import ConflictError, UsageError
from rtask.services.datasets.records import (
    ENDING,
    Choice,
    Records,
    merge_records,
    outliers,
    read_records,
    write_records,
)
from rtask.services.datasets.tree import Conflict, Entry, Merged, Strategy, Tree, merge, rule_for

__all__ = ["Merge"]


class Merge:
    """One merge.

    Parameters
    ----------
    rules
        What to do with conflicts, by the path of a file, of a folder that holds it or, for records,
        by ``path#key``; the longest one that fits counts. ``""`` is for all.
    key
        Field that tells records apart; empty where files are only bytes.
    read, write
        The bytes of a file, and back.
    """

    def __init__(
        self,
        rules: Mapping[str, Strategy],
        key: str,
        read: Callable[[Entry], bytes],
        write: Callable[[bytes], Entry],
    ) -> None:
        self._rules = rules
        self._key = key
        self._read, self._write = read, write

    def files(self, base: Tree, ours: Tree, theirs: Tree) -> Tree:
        """Return the files of the merged version.

        Raises
        ------
        ConflictError
            ``conflicts`` lists what no rule decided.
        """
        merged = merge(base, ours, theirs, self._rules, self._of_records if self._key else None)
        if merged.conflicts:
            raise _refused(merged)
        return merged.files

    def doubts(self, before: Tree, after: Tree) -> list[dict[str, Any]]:
        """Return numbers in records that a merge brought and that are far from all others."""
        doubts = []
        for path in sorted(path for path in after if self._key and path.endswith(ENDING)):
            if before.get(path) == after[path]:
                continue
            every = self._records(path, after[path]) or {}
            earlier = self._records(path, before.get(path)) or {}
            new = {name: record for name, record in every.items() if earlier.get(name) != record}
            doubts += [
                {"path": path, "key": json.loads(name), "field": field, "value": value}
                for name, field, value in outliers(every, new)
            ]
        return doubts

    def _of_records(
        self, path: str, base: Entry | None, ours: Entry, theirs: Entry
    ) -> tuple[Entry, list[Conflict]] | None:
        """Merge one file that both sides changed; none if it does not hold records."""
        if not path.endswith(ENDING):
            return None
        was, mine, other = (self._records(path, version) for version in (base, ours, theirs))
        if was is None or mine is None or other is None:
            return None
        conflicts: list[Conflict] = []

        def choose(name: str, kind: str) -> Choice | None:
            rule = rule_for(f"{path}#{json.loads(name)}", self._rules)
            if rule == "fail":
                conflicts.append(Conflict(path, kind, name))
                return None
            return rule

        merged = write_records(merge_records(was, mine, other, choose))
        return (ours if conflicts else self._write(merged)), conflicts

    def _records(self, path: str, entry: Entry | None) -> Records | None:
        """Return the records of a file; none if it does not hold any."""
        if entry is None:
            return {}
        try:
            return read_records(self._read(entry), self._key, path)
        except UsageError:
            return None  # from a fork of a time or a dataset that had no key


def _refused(merged: Merged) -> ConflictError:
    first = merged.conflicts[0]
    return ConflictError(
        f"{len(merged.conflicts)} conflicts, the first at {first.place}: {first.kind}; "
        "give a rule, ours or theirs",
        conflicts=[conflict.facts() for conflict in merged.conflicts],
    )
