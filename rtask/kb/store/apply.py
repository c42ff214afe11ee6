"""Apply one commit to the store atomically.

The store offers no transaction object, but ``extend`` and a whole ``update`` request are atomic:
readers, and a process that is killed, see all of it or nothing. A large change is applied in steps
at a third of the cost: additions through the store's bulk loader, those to the union first, then
removals. The journal holds the whole change durably beforehand, so the next opening completes it
after a kill or a power cut; it takes the union to hold what the named graphs do. Reader processes
receive it as one change; only code in this process can see the state between.
"""

from __future__ import annotations

from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.writes import Writes

__all__ = ["apply"]


def apply(store: GraphStore, writes: Writes) -> None:
    """Change the store in one atomic step, and tell those that follow it."""
    try:
        store.apply(writes)
    except BaseException:
        store.writes += 1  # what was looked up meanwhile may have been seen half made
        raise
    store.tell(writes)
