"""Plans for every thing of a scene, each with the others as obstacles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.scoring.select import rank

__all__ = ["plan_each_thing"]

_FEWEST = 30
"""Points of a thing on which anything is planned."""


def plan_each_thing(
    points: FloatArray,
    labels: NDArray[np.integer],
    up: FloatArray,
    most: int,
    plan: Callable[[FloatArray, FloatArray | None], Proposals],
) -> Proposals:
    """Return the best grasps of all things of a scene.

    Parameters
    ----------
    points : (n, 3), m
        Of things on a support, without the support.
    labels : (n,) int
        The thing of each point, from 1 on; 0 = none: in the way, but not to be taken.
    up : (3,)
        Unit vector against gravity.
    most
        Grasps in the answer.
    plan
        Takes the points of a thing and of all others, None if there are none.

    Returns
    -------
    Proposals
        Ranked over all things; ``segment`` is the label. The notes say why a thing has none.
    """
    found, counts, reasons = list[GraspCandidate](), dict[str, int](), list[str]()
    for label in np.unique(labels[labels > 0]).tolist():
        own = labels == label
        if own.sum() < _FEWEST:
            reasons.append(f"thing {label}: fewer than {_FEWEST} points")
            continue
        one = plan(points[own], points[~own] if (~own).any() else None)
        found += [replace(candidate, segment=label) for candidate in one]
        for name, count in one.counts.items():
            counts[name] = counts.get(name, 0) + count
        if not one:
            reasons.append(f"thing {label}: {one.reason}")
    if not found:
        return Proposals(reason="; ".join(reasons) or "the scene holds nothing", counts=counts)
    return Proposals(tuple(rank(found, up)[:most]), notes=tuple(reasons), counts=counts)
