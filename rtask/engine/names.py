"""New IRIs: numbered where people read them, time-ordered and unique elsewhere."""

from __future__ import annotations

import re
import threading
import unicodedata
from typing import TYPE_CHECKING

from rtask.rdf.namespaces import PREFIXES, owned_uuid7, uuid7
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Names", "slug", "tail", "uuid7"]

# Numbers are never reused, since IRIs of merged and forgotten objects remain valid.
_COUNTED = {
    "object": "{ ?thing a rt:ManipulableObject } UNION { ?thing rt:mergedInto ?other } "
    "UNION { ?thing prov:invalidatedAtTime ?when }",
    "grasp": "?thing rt:graspPose ?pose",
}


def slug(text: str) -> str:
    """Return lower-case ASCII letters, digits and hyphens, at most 60 characters.

    >>> slug("Blue  Müg!")
    'blue-mug'
    """
    plain = unicodedata.normalize("NFKD", text.casefold()).encode("ascii", "ignore").decode()
    words: list[str] = re.findall(r"[a-z0-9]+", plain)
    return "-".join(words)[:60].strip("-") or uuid7().hex


def tail(term: NamedNode) -> str:
    """Return the last part of an IRI, for use in another IRI.

    >>> tail(NamedNode("https://example.org/kb/object/12"))
    '12'
    """
    last = re.split(r"[#/:]", term.value)[-1]
    return last if re.fullmatch(r"[A-Za-z0-9._-]{1,64}", last) else slug(term.value)


class Names:
    """Mints the IRIs of one knowledge base.

    Numbers continue from the largest in the graph; the caller holds the engine's write lock while
    minting and storing.
    """

    def __init__(self, kb: GraphCore) -> None:
        self._kb = kb
        self._lock = threading.Lock()
        self._last = {kind: self._largest(kind) for kind in _COUNTED}
        self._new: set[NamedNode] = set()

    def counted(self, kind: str) -> NamedNode:
        """Return the next ``{base}object/<n>`` or ``{base}grasp/<n>``."""
        with self._lock:
            self._last[kind] += 1
            made = self.named(kind, str(self._last[kind]))
            self._new.add(made)
            return made

    def is_new(self, node: NamedNode) -> bool:
        """Whether an IRI was minted since the last commit, so that nothing is stored about it."""
        return node in self._new

    def forget_new(self) -> None:
        """Take note of a commit."""
        self._new = set()

    def unique(self, kind: str) -> NamedNode:
        """Return a fresh ``{base}<kind>/<uuid7>``."""
        return self.named(kind, str(uuid7()))

    def task(self, asked_by: str | None) -> NamedNode:
        """Return a fresh ``{base}task/<uuid7>`` that belongs to the robot of this name."""
        return self.named("task", str(owned_uuid7(asked_by or "")))

    def named(self, kind: str, name: str) -> NamedNode:
        """Return ``{base}<kind>/<name>``; the name must be fit for an IRI."""
        return iri(f"{self._kb.base}{kind}/{name}")

    def _largest(self, kind: str) -> int:
        start = f"{self._kb.base}{kind}/"
        rows = self._kb.select(
            f"{PREFIXES} SELECT DISTINCT ?thing {{ {_COUNTED[kind]} "
            f'FILTER(STRSTARTS(STR(?thing), "{start}")) }}'
        )
        tails = (str(row.value("thing"))[len(start) :] for row in rows)
        return max((int(tail) for tail in tails if tail.isdecimal()), default=0)
