"""Which bodies may touch each other: moveit_msgs/AllowedCollisionMatrix."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtask.errors import UsageError
from rtask.interop.ros.convert import Make

__all__ = ["CollisionMatrix"]


class CollisionMatrix:
    """Links and objects that may touch, by pairs and by defaults.

    A pair that the matrix does not hold has the default of its members; if both have one, both have
    to allow it. Without any, contact is a collision, as in MoveIt. Of an asymmetric entry both
    halves have to allow it.

    Parameters
    ----------
    names
        Of links and objects, in the order of the matrix.
    allowed : (n, n) bool
    defaults
        Of names, whether they may touch what the matrix does not hold.

    Examples
    --------
    >>> both = np.array([[False, True], [True, False]])
    >>> matrix = CollisionMatrix(["finger", "cup"], both, {"shelf": True, "cup": False})
    >>> matrix.allows("cup", "finger"), matrix.allows("palm", "shelf")
    (True, True)
    >>> matrix.allows("cup", "shelf")
    False
    """

    def __init__(
        self, names: Iterable[str], allowed: NDArray[np.bool_], defaults: Mapping[str, bool]
    ) -> None:
        self.names, self.defaults = tuple(names), dict(defaults)
        self._allowed = allowed & allowed.T
        self._places = {name: place for place, name in enumerate(self.names)}

    @classmethod
    def of(cls, message: Any) -> CollisionMatrix:
        """Return the matrix of a message.

        Raises
        ------
        UsageError
            It is not square, or names and values do not go together.
        """
        names = [str(name) for name in message.entry_names]
        rows = [[bool(value) for value in row.enabled] for row in message.entry_values]
        if len(rows) != len(names) or any(len(row) != len(names) for row in rows):
            raise UsageError(
                f"allowed collision matrix: {len(names)} names with rows of "
                f"{sorted({len(row) for row in rows})} values in {len(rows)} rows; expected a "
                "square"
            )
        if len(set(names)) != len(names):
            raise UsageError("allowed collision matrix: a name stands in it twice")
        defaults = list(message.default_entry_names), list(message.default_entry_values)
        if len(defaults[0]) != len(defaults[1]):
            raise UsageError(
                f"allowed collision matrix: {len(defaults[0])} names of defaults with "
                f"{len(defaults[1])} values"
            )
        square = np.array(rows, dtype=np.bool_).reshape(len(names), len(names))
        pairs = zip(*defaults, strict=True)
        return cls(names, square, {str(name): bool(value) for name, value in pairs})

    def allows(self, first: str, second: str) -> bool:
        """Return whether two bodies may touch."""
        if first in self._places and second in self._places:
            return bool(self._allowed[self._places[first], self._places[second]])
        given = [self.defaults[name] for name in (first, second) if name in self.defaults]
        return bool(given) and all(given)

    def with_pairs(
        self,
        allowed: Iterable[tuple[str, str]],
        refused: Iterable[tuple[str, str]] = (),
        gone: Collection[str] = (),
    ) -> CollisionMatrix:
        """Return the matrix with some pairs allowed, former ones refused, and without some names.

        Pairs of a new name with former ones stay what their defaults made them.
        """
        allowed = list(allowed)
        names_left = [name for name in self.names if name not in gone]
        names = list(dict.fromkeys([*names_left, *(name for pair in allowed for name in pair)]))
        square = np.zeros((len(names), len(names)), dtype=np.bool_)
        old = [self._places[name] for name in names_left]
        square[: len(old), : len(old)] = self._allowed[np.ix_(old, old)]
        for place, name in enumerate(names[len(old) :], start=len(old)):
            square[place] = square[:, place] = [self.allows(name, other) for other in names]
        places = {name: place for place, name in enumerate(names)}
        for pairs, may_touch in ((refused, False), (allowed, True)):
            for first, second in pairs:
                if first in places and second in places:
                    square[places[first], places[second]] = may_touch
                    square[places[second], places[first]] = may_touch
        return CollisionMatrix(names, square, self.defaults)

    def message(self, make: Make) -> Any:
        """Return it as moveit_msgs/AllowedCollisionMatrix."""
        made = make("moveit_msgs/AllowedCollisionMatrix")
        made.entry_names = list(self.names)
        for row in self._allowed.tolist():
            entry = make("moveit_msgs/AllowedCollisionEntry")
            entry.enabled = row
            made.entry_values.append(entry)
        made.default_entry_names = list(self.defaults)
        made.default_entry_values = list(self.defaults.values())
        return made
