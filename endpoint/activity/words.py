"""Words for people in place of the names and IRIs that robots report."""

from __future__ import annotations

AFTER = ("placed", "held", "lifted", "closed")
"""The first of these pictures that a robot took shows how an attempt ended."""


def title(name: str | None, classes: str | None = "") -> str:
    """Return what to call an object: its name, else its kind.

    Examples
    --------
    >>> title("tea tin"), title(None, "can, container"), title("", None)
    ('tea tin', 'unnamed can', 'unnamed object')
    """
    return name or f"unnamed {(classes or '').partition(',')[0] or 'object'}"
