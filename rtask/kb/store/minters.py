"""Minters of names: the robot or person in whose namespace an IRI is."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import unquote

__all__ = ["Minters"]

_MINTED = re.compile(r"(?:robot|person|agent|graph/agent)/([^/#]+)")


@dataclass(frozen=True)
class Minters:
    """Tells who minted a name, in one knowledge base.

    Parameters
    ----------
    base
        IRI below which the names of robots and persons are.

    Examples
    --------
    >>> minters = Minters("urn:lab/")
    >>> minters("urn:lab/robot/nao-2/cup"), minters("urn:cup")
    ('nao-2', None)
    """

    base: str

    def __call__(self, iri: str) -> str | None:
        """Return the name of the robot or person, or ``None``."""
        if not iri.startswith(self.base):
            return None
        match = _MINTED.match(iri, len(self.base))
        return None if match is None else unquote(match[1])
