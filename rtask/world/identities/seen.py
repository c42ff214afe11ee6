"""Things as robots see them, before it is known which ones they are."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rtask.world.placement import DEFAULT_SIGMA_M
from rtask.world.uncertainty import Spread

__all__ = ["Look", "Seen", "in_order"]

_CHANCE = 0.9


@dataclass(frozen=True, eq=False)
class Seen:
    """A thing of a product as seen by a robot.

    Parameters
    ----------
    product
        IRI of the product.
    frame, frame_from_exemplar
        IRI of the frame, and the pose (4, 4) in it, m.
    time_s
        When it was seen, Unix time.
    sigma_m
        Standard deviation of the position per axis, m.
    confidence
        In what it is and where, 0..1.
    min_extent_m
        The product's smaller horizontal extent, m; 0 if it is not known.
    is_round
        A turn about the z axis is no motion.
    robot
        IRI of the robot; what lies in its places or hands has an IRI below it.
    hands
        IRIs of the robot's end effectors.
    agent, source
        IRIs of the author and of the observation; or empty.
    exemplar
        IRI of the thing, if the robot says which it means; or empty.
    """

    product: str
    frame: str
    frame_from_exemplar: NDArray[np.float64]
    time_s: float
    sigma_m: float = DEFAULT_SIGMA_M
    confidence: float = 1.0
    min_extent_m: float = 0.0
    is_round: bool = False
    robot: str = ""
    hands: Collection[str] = ()
    agent: str = ""
    source: str = ""
    exemplar: str = ""


@dataclass
class Look:
    """What one commit says was seen, by which a thing is seen once at a time.

    Examples
    --------
    >>> look = Look()
    >>> cup = Seen("urn:cup", "urn:map", np.eye(4), 0.0, 0.004)
    >>> look.add(cup, "urn:thing")
    >>> look.has("urn:thing", 0.0), look.twice(cup)
    (True, 'urn:thing')
    """

    _seen: list[tuple[Seen, str]] = field(default_factory=list)

    def add(self, seen: Seen, exemplar: str) -> None:
        """Note as which thing something was seen."""
        self._seen.append((seen, exemplar))

    def has(self, exemplar: str, time_s: float) -> bool:
        """Whether a thing was seen at a time."""
        return any(name == exemplar and seen.time_s == time_s for seen, name in self._seen)

    def twice(self, seen: Seen) -> str:
        """Return the thing that was seen at the same spot at the same time, or "".

        Eyes may take one cup for two, whose bodies would then overlap.
        """
        reach_m = max(Spread(seen.sigma_m, 1.0, 0.0).radius(_CHANCE), seen.min_extent_m / 2.0)
        spot = seen.frame_from_exemplar[:3, 3]
        for other, exemplar in self._seen:
            is_alike = (other.product, other.frame, other.time_s) == (
                seen.product, seen.frame, seen.time_s,
            )  # fmt: skip
            away_m = float(np.linalg.norm(other.frame_from_exemplar[:3, 3] - spot))
            if is_alike and away_m <= reach_m:
                return exemplar
        return ""


def in_order(named: Sequence[int], away: Sequence[tuple[float, int, str]], count: int) -> list[int]:
    """Return the numbers of a look's sightings: named ones, then nearest pairs, then the rest.

    Parameters
    ----------
    away
        Distance, m, number of the sighting and IRI of the thing, sorted.

    Examples
    --------
    >>> in_order([], [(0.0, 1, "urn:b"), (0.07, 0, "urn:b"), (0.08, 0, "urn:a")], 2)
    [1, 0]
    """
    order, taken = list(named), set[str]()
    for _, number, exemplar in away:
        if number not in order and exemplar not in taken:
            order.append(number)
            taken.add(exemplar)
    return order + [number for number in range(count) if number not in order]
