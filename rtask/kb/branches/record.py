"""Record of a branch: its name, its author, where it begins and when it expires."""

from __future__ import annotations

import datetime as dt
import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rtask.errors import ForbiddenError, StoreFormatError, UsageError
from rtask.kb.commit.access import Access
from rtask.kb.durability.settings import write_durably

__all__ = ["FILE_NAME", "LIFETIME", "MAX_OPEN", "MAX_OPEN_EACH", "BranchRecord", "require_name"]

FILE_NAME = "branch.json"
LIFETIME = dt.timedelta(hours=24)
MAX_OPEN = 16
"""Branches of one graph: each keeps files that the trunk has rewritten since."""
MAX_OPEN_EACH = 4
"""Branches of one robot or person who is no admin, so that nobody takes the room of the others."""
_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,63}")


@dataclass(frozen=True)
class BranchRecord:
    """Where a branch begins, and whose it is.

    Parameters
    ----------
    name
        Name in the graph.
    author
        Name of the robot or person; empty for the program that opened the graph.
    base
        Number of the trunk's commit on which it rests.
    trunk
        Epoch of the trunk's numbering.
    epoch
        Epoch of its own numbering, which goes on from ``base``.
    made, expires
        UTC.
    note
        What it is for.
    """

    name: str
    author: str
    base: int
    trunk: str
    epoch: str
    made: dt.datetime
    expires: dt.datetime
    note: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values; times are in ISO 8601."""
        fields = asdict(self)
        return fields | {"made": self.made.isoformat(), "expires": self.expires.isoformat()}

    def require_may_drop(self, rights: Access) -> None:
        """Refuse to drop the branch for others than its author and admins.

        Raises
        ------
        ForbiddenError
            The caller is another.
        """
        if rights.role != "admin" and (rights.agent or "") != self.author:
            raise ForbiddenError(
                f"branch {self.name} is of {self.author or 'a caller without a name'}; its author "
                "or an admin drops it"
            )

    def require_may_write(self, rights: Access) -> None:
        """Refuse to let a robot or person write in a branch of another.

        What a stranger wrote there, the author could not merge.

        Raises
        ------
        ForbiddenError
            The caller is another, and no admin.
        """
        if rights.role in ("robot", "teacher") and rights.agent != self.author:
            raise ForbiddenError(
                f"branch {self.name} is of {self.author or 'a caller without a name'}; its author "
                "or an admin writes in it: make one of your own"
            )

    @classmethod
    def load(cls, folder: Path) -> BranchRecord:
        """Read the record in the folder of a branch.

        Raises
        ------
        StoreFormatError
            The file is not as it was written.
        """
        path = folder / FILE_NAME
        try:
            fields = json.loads(path.read_text("utf-8"))
            times = {key: dt.datetime.fromisoformat(fields[key]) for key in ("made", "expires")}
            return cls(**(fields | times))
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise StoreFormatError(
                f"{path} is damaged: {error}; delete {folder} to drop the branch"
            ) from error

    def save(self, folder: Path) -> None:
        """Write the record durably."""
        write_durably(folder / FILE_NAME, json.dumps(self.to_dict(), indent=2) + "\n")


def require_name(name: str) -> str:
    """Return the name of a branch if it can be one.

    Raises
    ------
    UsageError
        It has other characters, or too many.

    Examples
    --------
    >>> require_name("tuesday")
    'tuesday'
    """
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"{name[:80]!r} is no name of a branch: 1 to 64 of a-z, 0-9, '.', '_' and '-', "
            "beginning with a letter or digit"
        )
    return name
