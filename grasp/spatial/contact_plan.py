"""Grasps of suction cups and three-finger hands: on a mesh, a cloud, or every thing of a scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.clouds.ground import find_support
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions
from grasp.spatial.gripper_files import OtherHand
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.select import rank
from grasp.spatial.suction import plan_suction, plan_suction_on_cloud
from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.planning import plan_three_finger, plan_three_finger_on_cloud

__all__ = ["OtherHand", "plan_contacts", "plan_contacts_on_cloud", "plan_contacts_on_scene"]

_FEWEST = 30
"""Points of a thing on which anything is planned."""


def plan_contacts(
    mesh: Mesh,
    hand: OtherHand,
    surroundings: Surroundings | None = None,
    options: SpatialOptions | None = None,
    given: FloatArray | None = None,
) -> Proposals:
    """Plan where a hand takes a mesh; see :func:`~grasp.spatial.suction.plan_suction`.

    Parameters
    ----------
    given : (n, 4, 4) or None
        Poses of the hand in the mesh's frame, as from another planner or a data set, which are
        ranked instead of own ones; fingers close from there.

    Examples
    --------
    >>> from grasp.spatial.meshes.shapes import box_mesh
    >>> from grasp.spatial.three_finger.hand import ThreeFingerHand
    >>> box = box_mesh((0.1, 0.06, 0.04))
    >>> [len(plan_contacts(box, hand)) > 0
    ...  for hand in (SuctionCup("cup"), ThreeFingerHand("three", max_opening=0.1))]
    [True, True]
    """
    if isinstance(hand, SuctionCup):
        return plan_suction(mesh, hand, surroundings, options, given)
    return plan_three_finger(mesh, hand, surroundings, options, given)


def plan_contacts_on_cloud(
    points: FloatArray,
    hand: OtherHand,
    support: Support | None = None,
    viewpoints: FloatArray | None = None,
    options: SpatialOptions | None = None,
    neighbours: FloatArray | None = None,
) -> Proposals:
    """Plan where a hand takes the object of a cloud (n, 3), m.

    See :func:`~grasp.spatial.suction.plan_suction_on_cloud`, whose parameters these are. Without a
    support, one that the cloud shows is taken, and a note says so.
    """
    options = options or SpatialOptions()
    shown = find_support(points) if support is None and options.find_support else None
    if shown is not None:
        points, support = shown.standing, shown.support
    if isinstance(hand, SuctionCup):
        planned = plan_suction_on_cloud(points, hand, support, viewpoints, options, neighbours)
    else:
        planned = plan_three_finger_on_cloud(points, hand, support, viewpoints, options, neighbours)
    return planned if shown is None else replace(planned, notes=(shown.note, *planned.notes))


def plan_contacts_on_scene(
    points: FloatArray,
    labels: NDArray[np.integer],
    hand: OtherHand,
    support: Support,
    viewpoints: FloatArray | None = None,
    options: SpatialOptions | None = None,
) -> Proposals:
    """Plan where a hand takes any thing of a scene, each with the others as obstacles.

    Parameters
    ----------
    points : (n, 3), m
        Of things on a support, without the support.
    labels : (n,) int
        The thing of each point, from 1 on; 0 = none: in the way, but not to be taken.
    support, viewpoints, options
        As of :func:`plan_contacts_on_cloud`.

    Returns
    -------
    Proposals
        Ranked over all things; ``segment`` is the label. The notes say why a thing has none.
    """
    options = options or SpatialOptions()
    candidates, counts, reasons = list[GraspCandidate](), dict[str, int](), list[str]()
    for label in np.unique(labels[labels > 0]).tolist():
        own = labels == label
        if own.sum() < _FEWEST:
            reasons.append(f"thing {label}: fewer than {_FEWEST} points")
            continue
        others = points[~own] if (~own).any() else None
        part_plan = plan_contacts_on_cloud(points[own], hand, support, viewpoints, options, others)
        candidates += [replace(candidate, segment=label) for candidate in part_plan]
        for name, count in part_plan.counts.items():
            counts[name] = counts.get(name, 0) + count
        if not part_plan:
            reasons.append(f"thing {label}: {part_plan.reason}")
    if not candidates:
        return Proposals(reason="; ".join(reasons) or "the scene holds nothing", counts=counts)
    best = tuple(rank(candidates, support.up)[: options.most])
    return Proposals(best, notes=tuple(reasons), counts=counts)
