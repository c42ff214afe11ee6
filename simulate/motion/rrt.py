"""Collision-free paths in joint space: RRT-Connect with shortcutting.

Kuffner and LaValle 2000, with a seeded generator and a limit on iterations instead of seconds, so
that the same request always has the same result.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulate.robots.description import Floats

__all__ = ["PlanOptions", "edge_is_free", "plan_path", "search", "shortcut", "trivial_path"]
IsFree = Callable[[Floats], NDArray[np.bool_]]
"""Takes postures (b, dof) rad, returns (b,) bool."""


@dataclass(frozen=True)
class PlanOptions:
    """Parameters of the planner; ``resolution`` and ``step`` in rad, infinity norm."""

    resolution: float = 0.06
    step: float = 0.35
    iterations: int = 1500
    shortcuts: int = 40


def edge_is_free(a: Floats, b: Floats, is_free: IsFree, resolution: float) -> bool:
    """Return whether the straight edge between two postures (dof,) is free, ends included."""
    count = max(int(np.ceil(np.max(np.abs(b - a)) / resolution)), 1)
    fractions = np.linspace(0, 1, count + 1)[:, None]
    return bool(is_free(a + fractions * (b - a)).all())


def plan_path(
    start: Floats,
    goal: Floats,
    lower: Floats,
    upper: Floats,
    is_free: IsFree,
    rng: np.random.Generator,
    options: PlanOptions | None = None,
) -> Floats | str:
    """Plan a path between two postures.

    Parameters
    ----------
    start, goal : (dof,) float, rad
    lower, upper : (dof,) float, rad
        Joint limits.
    is_free
        Collision check of a batch of postures.
    rng
        Source of samples.
    options
        Resolution and limits.

    Returns
    -------
    (k, dof) float or str
        The corners of the path, or the reason code ``rrt_start``, ``rrt_goal``, ``rrt_time``.
    """
    options = options or PlanOptions()
    trivial = trivial_path(start, goal, is_free, options)
    if trivial is not None:
        return trivial
    for path in search(start, goal, lower, upper, is_free, rng, options):
        if path is not None:
            return shortcut(path, is_free, rng, options)
    return "rrt_time"


def trivial_path(
    start: Floats, goal: Floats, is_free: IsFree, options: PlanOptions
) -> Floats | str | None:
    """Return the straight path, the reason why there can be none, or None: a search is needed."""
    if not is_free(start[None])[0]:
        return "rrt_start"
    if not is_free(goal[None])[0]:
        return "rrt_goal"
    if edge_is_free(start, goal, is_free, options.resolution):
        return np.stack([start, goal])
    return None


class _Tree:
    """Postures with their parents, in one growing array."""

    def __init__(self, root: Floats, capacity: int) -> None:
        self._nodes = np.empty((capacity, len(root)))
        self._nodes[0] = root
        self._parents = [-1]

    def add(self, q: Floats, parent: int) -> int:
        if len(self._parents) == len(self._nodes):
            self._nodes = np.concatenate([self._nodes, np.empty_like(self._nodes)])
        self._nodes[len(self._parents)] = q
        self._parents.append(parent)
        return len(self._parents) - 1

    def nearest(self, q: Floats) -> int:
        # Squares suffice for the nearest; this is where a search spends its time beside the checks.
        difference = self._nodes[: len(self._parents)] - q
        return int(np.argmin(np.einsum("nd,nd->n", difference, difference)))

    def node(self, index: int) -> Floats:
        node: Floats = self._nodes[index].copy()
        return node

    def branch(self, index: int) -> list[Floats]:
        """Return the postures from a node to the root."""
        branch = []
        while index >= 0:
            branch.append(self.node(index))
            index = self._parents[index]
        return branch


def search(
    start: Floats,
    goal: Floats,
    lower: Floats,
    upper: Floats,
    is_free: IsFree,
    rng: np.random.Generator,
    options: PlanOptions,
) -> Generator[Floats | None]:
    """Grow the two trees; yield None after each step, and at last the path (k, dof), if any.

    So another way to find a path can take turns with it (:mod:`simulate.motion.remembered`).
    """
    trees = [_Tree(start, 512), _Tree(goal, 512)]
    for iteration in range(options.iterations):
        grown, other = trees[iteration % 2], trees[1 - iteration % 2]
        sample = lower + rng.random(len(start)) * (upper - lower)
        new = _extend(grown, sample, is_free, options)
        reached = None if new is None else _grow_to(other, grown.node(new), is_free, options)
        if new is not None and reached is not None:
            here, there = grown.branch(new), other.branch(reached)
            forward = here[::-1] + there[1:]
            yield np.array(forward if iteration % 2 == 0 else forward[::-1])
            return
        yield None


def _extend(tree: _Tree, target: Floats, is_free: IsFree, options: PlanOptions) -> int | None:
    """Grow a tree by one step towards a posture; return the new node."""
    near = tree.nearest(target)
    q = tree.node(near)
    difference = target - q
    length = float(np.max(np.abs(difference)))
    # The sample is a posture of the tree: a way of no length has no direction.
    if length < 1e-9:
        return near
    new = q + difference * min(1.0, options.step / length)
    return tree.add(new, near) if edge_is_free(q, new, is_free, options.resolution) else None


def _grow_to(tree: _Tree, target: Floats, is_free: IsFree, options: PlanOptions) -> int | None:
    """Grow a tree towards a posture until it is reached or blocked."""
    while True:
        new = _extend(tree, target, is_free, options)
        if new is None:
            return None
        if np.max(np.abs(tree.node(new) - target)) < 1e-9:
            return new


def shortcut(
    path: Floats, is_free: IsFree, rng: np.random.Generator, options: PlanOptions
) -> Floats:
    """Replace detours between two random points of a path by straight edges where free."""
    corners = list(path)
    for _ in range(options.shortcuts):
        if len(corners) <= 2:
            break
        # Points on the edges, too: cuts between corners alone leave the bends of the search.
        first, second = np.sort(rng.random(2) * (len(corners) - 1))
        i, j = int(first), int(second)
        if i == j:
            continue
        a = corners[i] + (first - i) * (corners[i + 1] - corners[i])
        b = corners[j] + (second - j) * (corners[min(j + 1, len(corners) - 1)] - corners[j])
        if edge_is_free(a, b, is_free, options.resolution):
            corners = [*corners[: i + 1], a, b, *corners[j + 1 :]]
    # Points that coincide would give a piece of the trajectory no time.
    keep = [corners[0]]
    keep += [q for q in corners[1:] if np.max(np.abs(q - keep[-1])) > 1e-6]
    return np.array(keep)
