"""A process that asks its readers a question without end, and says who they are.

Run as ``python reader_owner.py``; prints the process numbers of keeper and readers.
"""

from __future__ import annotations

import threading
import time

import rtask

_ENDLESS = "SELECT (COUNT(*) AS ?n) { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i }"


def main() -> None:
    """Ask until killed."""
    with rtask.open(":memory:", reason=False) as kb:
        kb.warm_up()
        asking = threading.Thread(target=kb.query, args=(_ENDLESS,), kwargs={"timeout_s": 60.0})
        asking.daemon = True
        asking.start()
        while kb.stats()["readers"]["running"] == 0:
            time.sleep(0.01)
        print(*kb.stats()["readers"]["processes"], flush=True)  # noqa: T201 - this is its report
        time.sleep(60.0)


if __name__ == "__main__":
    main()
