"""Share of the headroom that sharing wins with whole arms.

The headroom is the distance from the first tries of the first robot to the best grasp of each
product. With whole arms the best grasp is not known: no more than one sample of each pose is drawn.
A product that any robot ever delivered can be held, so that its best grasp is taken to hold always.
That is an upper bound, and the share won a lower one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulate.fleet.figures import objects_tried
from simulate.study.intervals import bootstrap

__all__ = ["headroom_won", "headroom_words"]

_CONDITIONS = ("shared", "not shared")
_MIN_ROOMS = 8
"""Products with headroom from which on hardly any resample holds none (3 in 10,000)."""


def headroom_won(results: Sequence[Mapping[str, Any]], condition: str) -> dict[str, Any]:
    """Return the share of the headroom that the last robot won, as JSON data.

    Parameters
    ----------
    results
        Fleets of :func:`simulate.fleet.sharing.sharing_trial`.
    condition
        ``shared`` or ``not shared``.

    Returns
    -------
    dict
        ``first_try``, the shares of first tries that held of the first and the last robot, and
        ``best``, that of the best grasps, over ``n`` common products that both robots tried; and
        ``won`` with its interval over products (``interval95``), None where no robot ever failed.
        There is no interval where so few products leave headroom that resamples often hold none.
    """
    rows = np.array(
        [row for result in results for row in _first_tries(result, condition)], dtype=np.float64
    ).reshape(-1, 3)
    first, last, best = rows.T

    def won(i: NDArray[np.intp]) -> float:
        room = (best[i] - first[i]).sum()
        return float((last[i] - first[i]).sum() / room) if room else 0.0

    everything = np.arange(len(rows))
    rooms = int((best - first).sum())
    has_interval = rooms >= _MIN_ROOMS
    return {
        "n": len(rows),
        "first_try": [round(float(v.mean()), 4) for v in (first, last)] if len(rows) else None,
        "best": round(float(best.mean()), 4) if len(rows) else None,
        "won": round(won(everything), 4) if rooms else None,
        "interval95": [round(v, 4) for v in bootstrap(won, len(rows))] if has_interval else None,
    }


def _first_tries(result: Mapping[str, Any], condition: str) -> list[tuple[bool, bool, bool]]:
    """Return for each common product whether the first try of the first and of the last robot held,
    and whether any robot ever held it.
    """
    robots = [objects_tried(robot) for robot in result[condition]]
    tries = [{met["product"]: met["tries_to_success"] for met in robot} for robot in robots]
    held = {
        met["product"]
        for each in _CONDITIONS
        for robot in result[each]
        for met in objects_tried(robot)
        if met["tries_to_success"]
    }
    return [
        (tries[0][name] == 1, tries[-1][name] == 1, name in held)
        for name in result["common"]
        if name in tries[0] and name in tries[-1]
    ]


def headroom_words(headroom: Mapping[str, Any]) -> str:
    """Return the share won with the first tries from which it follows.

    >>> headroom_words({"n": 8, "first_try": [0.5, 0.875], "best": 1.0, "won": 0.75,
    ...                 "interval95": [0.25, 1.0]})
    'at least 0.75 [0.25, 1.00]; first tries 0.50 -> 0.88 of 1.00 that can be held, 8 products'
    >>> headroom_words({"n": 12, "first_try": [0.75, 0.75], "best": 1.0, "won": 0.0,
    ...                 "interval95": None})
    'at least 0.00, too few for an interval; first tries 0.75 -> 0.75 of 1.00 that can be held, \
12 products'
    >>> headroom_words({"n": 0, "first_try": None, "best": None, "won": None, "interval95": None})
    '-'
    """
    if headroom["won"] is None:
        return "-"
    first, last = headroom["first_try"]
    interval = ", too few for an interval"
    if headroom["interval95"] is not None:
        interval = " [{:.2f}, {:.2f}]".format(*headroom["interval95"])
    return (
        f"at least {headroom['won']:.2f}{interval}; first tries {first:.2f} -> "
        f"{last:.2f} of {headroom['best']:.2f} that can be held, {headroom['n']} products"
    )
