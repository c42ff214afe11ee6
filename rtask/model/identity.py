"""Identity map: one object per IRI as long as it is in use, kept up to date."""

from __future__ import annotations

import threading
from collections.abc import Container
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

from rtask.model.instance import Model

if TYPE_CHECKING:
    from rtask.model.backing import Touched

__all__ = ["IdentityMap"]


class IdentityMap:
    """The objects of a session by IRI.

    Parameters
    ----------
    changed
        Objects with unwritten changes, which commits of others do not expire.
    """

    def __init__(self, changed: Container[Model]) -> None:
        self._instances: WeakValueDictionary[str, Model] = WeakValueDictionary()
        self._changed = changed
        self._stale: set[str] = set()
        self._all_stale = False
        self._lock = threading.Lock()

    def find(self, name: str) -> Model | None:
        """Return the object of an IRI, if there is one."""
        if self._stale or self._all_stale:
            self._expire()
        return self._instances.get(name)

    def add(self, name: str, instance: Model) -> None:
        """Add an object."""
        self._instances[name] = instance

    def drop(self, name: str) -> None:
        """Remove an object."""
        self._instances.pop(name, None)

    def all(self) -> list[Model]:
        """Return all objects that are in use."""
        return list(self._instances.values())

    def hear(self, touched: Touched) -> None:
        """Mark the objects that commits touched as stale, or all; runs in any thread."""
        with self._lock:
            if touched is None:
                self._all_stale = True
            else:
                self._stale.update(touched)

    def _expire(self) -> None:
        """Expire objects that others changed, unless they have unwritten changes."""
        with self._lock:
            stale, self._stale = self._stale, set()
            if self._all_stale:
                stale, self._all_stale = set(self._instances), False
        for name in stale:
            instance = self._instances.get(name)
            if instance is not None and instance not in self._changed:
                instance.__state__.forget()
