"""All entries, and finding them by what a reader types."""

from __future__ import annotations

from rtask.errors import UsageError
from simulate.thesis import beyond, capabilities, gatto, kehoe
from simulate.thesis.entry import Entry

__all__ = ["ENTRIES", "entries_named"]

ENTRIES: tuple[Entry, ...] = (
    *gatto.ENTRIES,
    *(entry for entry in capabilities.ENTRIES if entry.thesis == "gatto"),
    *kehoe.ENTRIES,
    *(entry for entry in capabilities.ENTRIES if entry.thesis == "kehoe"),
    *beyond.ENTRIES,
)


def entries_named(name: str) -> list[Entry]:
    """Return the entries that a name means: one, or all of a number (``kehoe-3.1``).

    Raises
    ------
    UsageError
        Nothing is named so; the message has the nearest names.

    Examples
    --------
    >>> [entry.name for entry in entries_named("kehoe-3.1")]
    ['kehoe-fig-3.1', 'kehoe-table-3.1']
    """
    typed = name.strip().lower().replace("figure", "fig").replace(" ", "-")
    exact = [entry for entry in ENTRIES if entry.name == typed]
    if exact:
        return exact
    thesis, _, number = typed.partition("-")
    numbered = [e for e in ENTRIES if e.thesis == thesis and e.number == number]
    if numbered:
        return numbered
    near = [e.name for e in ENTRIES if number and (number in e.name or e.number in number)]
    some = near or [entry.name for entry in ENTRIES]
    raise UsageError(
        f"no entry is named {name!r}; perhaps {', '.join(some[:4])}; `rtask thesis` lists all"
    )
