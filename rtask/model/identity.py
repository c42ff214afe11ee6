"""Identity map: one object per IRI as long as it is in use, kept up to date."""

from __future__ import annotations

import threading
from collections.abc import Container
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

from rtask.model.instance import Model
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Change

__all__ = ["IdentityMap"]


class IdentityMap:
    """The objects of a session by IRI.

    Parameters
    ----------
    changed
        Objects with unwritten changes, which commits of others do not expire.
    """

    def __init__(self, changed: Container[Model]) -> None:
        self._known: WeakValueDictionary[str, Model] = WeakValueDictionary()
        self._changed = changed
        self._stale: set[str] = set()
        self._lock = threading.Lock()

    def find(self, name: str) -> Model | None:
        """Return the object of an IRI, if there is one."""
        if self._stale:
            self._expire()
        return self._known.get(name)

    def add(self, name: str, instance: Model) -> None:
        """Add an object."""
        self._known[name] = instance

    def drop(self, name: str) -> None:
        """Remove an object."""
        self._known.pop(name, None)

    def all(self) -> list[Model]:
        """Return all objects that are in use."""
        return list(self._known.values())

    def hear(self, change: Change) -> None:
        """Mark the objects that a commit touches as stale; runs in the writer's thread."""
        quads = (*change.added, *change.removed, *change.inferred_added, *change.inferred_removed)
        names = {quad.subject.value for quad in quads if isinstance(quad.subject, NamedNode)}
        with self._lock:
            self._stale |= names

    def _expire(self) -> None:
        """Expire objects that others changed, unless they have unwritten changes."""
        with self._lock:
            stale, self._stale = self._stale, set()
        for name in stale:
            instance = self._known.get(name)
            if instance is not None and instance not in self._changed:
                instance.__state__.forget()
