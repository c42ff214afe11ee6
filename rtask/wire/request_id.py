"""Ids by which what a request reports is stored once, however often the request arrives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["RequestId", "StoredOnce"]


@dataclass(frozen=True)
class StoredOnce:
    """Marks the field of a message that identifies what it reports.

    Parameters
    ----------
    where
        Field and value to which this is restricted; None = always. In other requests of the same
        class the field means something else.
    """

    where: tuple[str, str] | None = None


@dataclass(frozen=True)
class RequestId:
    """Where a request carries its ids.

    Parameters
    ----------
    field
        Field that is marked with :class:`StoredOnce`.
    entries
        Field with a list of entries, each of which has an id; empty = the request has one.
    where
        As in :class:`StoredOnce`.

    Examples
    --------
    >>> RequestId("task_id").filled({"success": True}, lambda end: f"k{end}")
    {'success': True, 'task_id': 'k'}
    >>> several = RequestId("task_id", "objects")
    >>> several.filled({"objects": [{"task_id": "t-1"}, {}]}, lambda end: f"k{end}")
    {'objects': [{'task_id': 't-1'}, {'task_id': 'k.1'}]}
    """

    field: str
    entries: str = ""
    where: tuple[str, str] | None = None

    def applies_to(self, args: Mapping[str, Any]) -> bool:
        """Return whether this request is stored once for each id."""
        return self.where is None or args.get(self.where[0]) == self.where[1]

    def filled(self, args: Mapping[str, Any], new_id: Callable[[str], str]) -> dict[str, Any]:
        """Return the arguments with an id wherever one is missing.

        Parameters
        ----------
        new_id
            Returns an id that ends with the given text: empty, or ``.0``, ``.1`` for several
            entries.
        """
        entries = args.get(self.entries) if self.entries else None
        if entries is None:  # the fields of one entry may stand at top level
            return {**args, self.field: args.get(self.field) or new_id("")}
        if not isinstance(entries, list):
            return dict(args)
        filled = [
            {**entry, self.field: entry.get(self.field) or new_id(end)}
            if isinstance(entry, dict)
            else entry
            for entry, end in zip(entries, _ends(len(entries)), strict=True)
        ]
        return {**args, self.entries: filled}


def _ends(count: int) -> list[str]:
    return [""] if count == 1 else [f".{number}" for number in range(count)]
