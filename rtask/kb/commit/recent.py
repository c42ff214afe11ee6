"""Which graphs the last commits changed, for those who read some graphs before and write now."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

from rtask.kb.commit.commit import Change
from rtask.rdf.terms import GraphName

__all__ = ["RecentChanges"]

_KEPT = 1_000


class RecentChanges:
    """Graphs changed by each of the last commits; used while nobody writes.

    Commits that were not noted, such as those of another process, count as changes of all graphs.
    """

    def __init__(self) -> None:
        self._changes: deque[tuple[int, frozenset[GraphName]]] = deque(maxlen=_KEPT)

    def note(self, change: Change) -> None:
        """Take note of a commit that was stored."""
        self._changes.append((change.commit.seq, change.graphs))

    def left_alone(self, graphs: Iterable[GraphName], since: int, until: int) -> bool:
        """Whether no commit after one, up to another, changed any of some asserted graphs.

        >>> RecentChanges().left_alone([], 3, 3), RecentChanges().left_alone([], 3, 4)
        (True, False)
        """
        asked, number = frozenset(graphs), until
        for seq, changed in reversed(self._changes):
            if number == since or seq != number or not changed.isdisjoint(asked):
                break
            number -= 1
        return number == since
