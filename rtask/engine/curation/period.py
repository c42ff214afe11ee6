"""What the commits of a period stored, read from the journal."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING

from rtask.errors import GoneError, UsageError
from rtask.kb.store.overlay import NetChange
from rtask.rdf.terms import moment

if TYPE_CHECKING:
    from rtask.engine.context import Context

__all__ = ["LATEST_S", "stored_in"]

LATEST_S = 253_402_300_799
"""End of the year 9999, s since the epoch."""


def stored_in(context: Context, since: dt.datetime | None, until: dt.datetime | None) -> NetChange:
    """Return what the commits of a period added and removed together, by the server's clock.

    Raises
    ------
    UsageError
        The period ends before it begins.
    GoneError
        The journal no longer reaches back so far.
    """
    if since is not None and until is not None and since >= until:
        raise UsageError("until: the period ends before it begins", field="until")
    kb, total = context.kb, NetChange()
    oldest = kb.feed.oldest_retained()
    if 1 < oldest <= kb.seq:
        begin = kb.history(since=oldest - 1, upto=oldest)
        if since is None or any(moment(entry.time) > since for entry in begin):
            raise GoneError(
                f"since: commits before {oldest} are no longer kept; what they stored cannot be "
                "told from the rest",
                oldest=oldest,
            )
    for entry in kb.history(start=since, end=until):
        total.join(NetChange(dict.fromkeys(entry.removed), dict.fromkeys(entry.added)))
    return total
