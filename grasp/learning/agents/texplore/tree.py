"""Decision trees on exact output values, grown one experience at a time (C4.5, Quinlan 1993).

All trees of a forest live side by side in arrays, so that compiled code can use them without the
interpreter's lock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray

__all__ = ["Forest", "ForestSettings"]

Ints = NDArray[np.int64]

_LEAF, _GREATER, _EQUAL = -1, 0, 1
_NEGLIGIBLE = 1e-4


@dataclass(frozen=True)
class ForestSettings:
    """Parameters of growing a forest.

    Parameters
    ----------
    trees
        How many.
    share
        Probability that a tree gets to see an experience.
    skip
        Probability that a split is not considered.
    surprise
        A tree that gave an outcome a smaller probability than this is rebuilt.
    smoothing
        Experiences for which the node above counts at each node, when a tree predicts. Leaves
        with few experiences are else too sure: two unlucky steps through a door make it a wall
        (m-estimate, Cestnik 1990; along the branch, Ferri et al. 2003). What does not surprise a
        tree is then counted along its branch too, or hope in a wall would last. 0 = none of this,
        as published.
    """

    trees: int = 5
    share: float = 0.55
    skip: float = 0.2
    surprise: float = 0.75
    smoothing: float = 0.5

    def __post_init__(self) -> None:
        if (
            self.trees < 1
            or not 0 < self.share <= 1
            or not 0 <= self.skip < 1
            or self.smoothing < 0
        ):
            raise ValueError(f"a forest cannot grow with {self}")


class Forest:
    """An ensemble of trees that predicts the distribution of one output.

    A tree is rebuilt only when an experience surprises it; as published, its leaves hold the counts
    of then. A node that would split as before keeps its other branch.

    Parameters
    ----------
    inputs
        Number of features.
    settings
        How it grows.
    resolution
        Outputs closer than this are one.
    seed
        Of its random numbers.
    """

    def __init__(self, inputs: int, settings: ForestSettings, resolution: float, seed: int) -> None:
        self.settings = settings
        self.resolution = resolution
        self.random = np.array([seed * 2 + 1], dtype=np.uint64)
        self.outputs: list[float] = []
        trees = settings.trees
        self.x = np.zeros((64, inputs))
        self.y = np.zeros(64, dtype=np.int64)
        self.count = 0
        self.members = np.zeros((trees, 64), dtype=np.int64)
        self.sizes = np.zeros(trees, dtype=np.int64)
        # of a node: feature (-1 = leaf), test (> or ==), child where it holds (else the next)
        self.nodes = np.full((trees, 16, 3), _LEAF, dtype=np.int64)
        self.limits = np.zeros((trees, 16))
        self.counts = np.zeros((trees, 16, 1))
        self.used = np.zeros(trees, dtype=np.int64)

    def add(self, x: FloatArray, output: float) -> bool:
        """Learn one experience; return whether a tree changed.

        Parameters
        ----------
        x : (inputs,)
            Features.
        output
            What came of them.
        """
        index = self._remember(x, self._class_of(output))
        changed = False
        for tree in self._lucky_trees():
            self._give(tree, index)
            if self.used[tree] and self._expected(tree, index) >= self.settings.surprise:
                if self.settings.smoothing:
                    count_along(self.x[index], self.y[index], self.nodes[tree], self.limits[tree],
                                self.counts[tree])  # fmt: skip
                    changed = True
                continue
            self._rebuild(tree, index)
            changed = True
        return changed

    def predict(self, x: FloatArray) -> FloatArray:
        """Return the probability (classes,) of each of :attr:`outputs`; none learned: empty."""
        result = np.zeros(len(self.outputs))
        if self.count:
            predict(
                x, self.nodes, self.limits, self.counts, self.used, self.settings.smoothing, result
            )
        return result

    def _class_of(self, output: float) -> int:
        for number, existing in enumerate(self.outputs):
            if abs(existing - output) < self.resolution:
                return number
        self.outputs.append(output)
        missing = len(self.outputs) - self.counts.shape[2]
        if missing > 0:
            wider = np.zeros((*self.counts.shape[:2], missing + 3))
            self.counts = np.concatenate([self.counts, wider], axis=2)
        return len(self.outputs) - 1

    def _remember(self, x: FloatArray, output: int) -> int:
        if self.count == len(self.y):
            self.x = np.concatenate([self.x, np.zeros_like(self.x)])
            self.y = np.concatenate([self.y, np.zeros_like(self.y)])
        self.x[self.count], self.y[self.count] = x, output
        self.count += 1
        return self.count - 1

    def _lucky_trees(self) -> list[int]:
        trees = range(self.settings.trees)
        lucky = [tree for tree in trees if uniform(self.random) < self.settings.share]
        return lucky or [int(uniform(self.random) * self.settings.trees)]

    def _give(self, tree: int, index: int) -> None:
        if self.sizes[tree] == self.members.shape[1]:
            self.members = np.concatenate([self.members, np.zeros_like(self.members)], axis=1)
        self.members[tree, self.sizes[tree]] = index
        self.sizes[tree] += 1

    def _expected(self, tree: int, index: int) -> float:
        leaf = leaf_of(self.x[index], self.nodes[tree], self.limits[tree])
        counts = self.counts[tree, leaf]
        return float(counts[self.y[index]] / max(counts.sum(), 1.0))

    def _rebuild(self, tree: int, index: int) -> None:
        members = self.members[tree, : self.sizes[tree]]
        # A tree of n leaves has 2 n - 1 nodes, and what is cut off stays until the next clearing.
        if self.used[tree] + 2 * len(members) > self.nodes.shape[1]:
            if self.used[tree] > 4 * len(members):
                self.used[tree] = 0
            room = max(self.used[tree] + 4 * len(members) - self.nodes.shape[1], 0)
            self.nodes = np.pad(self.nodes, ((0, 0), (0, room), (0, 0)), constant_values=_LEAF)
            self.limits = np.pad(self.limits, ((0, 0), (0, room)))
            self.counts = np.pad(self.counts, ((0, 0), (0, room), (0, 0)))
        self.used[tree] = grow(
            self.x, self.y, members, index, len(self.outputs), self.settings.skip, self.random,
            self.nodes[tree], self.limits[tree], self.counts[tree], int(self.used[tree]),
        )  # fmt: skip

    def arrays(self, name: str) -> dict[str, NDArray[np.generic]]:
        """Return everything learned, by names that start with ``name``."""
        parts = ("random", "x", "y", "members", "sizes", "nodes", "limits", "counts", "used")
        arrays = {f"{name}_{part}": getattr(self, part) for part in parts}
        arrays[f"{name}_outputs"] = np.array(self.outputs)
        arrays[f"{name}_count"] = np.array(self.count)
        return arrays

    def take(self, name: str, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Take over what :meth:`arrays` returned."""
        for key, value in arrays.items():
            part = key.removeprefix(f"{name}_")
            if key == f"{name}_outputs":
                self.outputs = [float(v) for v in value]
            elif key == f"{name}_count":
                self.count = int(value)
            elif key.startswith(f"{name}_"):
                setattr(self, part, np.array(value))


@numba.njit(cache=True, nogil=True)
def uniform(state: NDArray[np.uint64]) -> float:
    """Return a random number in [0, 1): splitmix64 (Steele et al. 2014), its state in an array."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z ^= z >> np.uint64(31)
    return float(z >> np.uint64(11)) / 9007199254740992.0


@numba.njit(cache=True, nogil=True)
def _child_of(x: FloatArray, node: int, nodes: Ints, limits: FloatArray) -> int:
    value, limit = x[nodes[node, 0]], limits[node]
    holds = value > limit if nodes[node, 1] == _GREATER else value == limit
    return int(nodes[node, 2] if holds else nodes[node, 2] + 1)


@numba.njit(cache=True, nogil=True)
def leaf_of(x: FloatArray, nodes: Ints, limits: FloatArray) -> int:
    """Return the leaf that an input falls into."""
    node = 0
    while nodes[node, 0] != _LEAF:
        node = _child_of(x, node, nodes, limits)
    return node


@numba.njit(cache=True, nogil=True)
def count_along(x: FloatArray, y: int, nodes: Ints, limits: FloatArray, counts: FloatArray) -> None:
    """Count an experience at each node of a tree that it comes by, from the root to its leaf."""
    node = 0
    while nodes[node, 0] != _LEAF:
        counts[node, y] += 1
        node = _child_of(x, node, nodes, limits)
    counts[node, y] += 1


@numba.njit(cache=True, nogil=True)
def predict(
    x: FloatArray,
    nodes: Ints,
    limits: FloatArray,
    counts: FloatArray,
    used: Ints,
    smoothing: float,
    result: FloatArray,
) -> None:
    """Write the mean of the trees' distributions over classes into ``result``."""
    result[:] = 0.0
    shares = np.empty(len(result))
    trees = 0
    for tree in range(len(used)):
        if used[tree] == 0:
            continue
        trees += 1
        node, above = 0, 0.0  # above the root there is nothing to count
        while True:
            total = counts[tree, node].sum() + above
            for k in range(len(result)):
                prior = above * shares[k] if above else 0.0
                shares[k] = (counts[tree, node, k] + prior) / total
            if nodes[tree, node, 0] == _LEAF:
                break
            node, above = _child_of(x, node, nodes[tree], limits[tree]), smoothing
        result += shares
    if trees:
        result /= trees


@numba.njit(cache=True, nogil=True)
def _entropy(counts: FloatArray, total: float) -> float:
    sum_ = 0.0
    for n in counts:
        if n > 0:
            sum_ -= n / total * np.log(n / total)
    return sum_


@numba.njit(cache=True, nogil=True)
def gain_ratio(held: FloatArray, all_: FloatArray) -> float:
    """Return information gained by a test over the information of the test itself (natural log).

    Parameters
    ----------
    held, all_ : (classes,)
        Counts where the test holds, and everywhere.
    """
    n, total = held.sum(), all_.sum()
    if n == 0 or n == total:
        return 0.0
    other = all_ - held
    split = np.array([n, total - n])
    gain = _entropy(all_, total)
    gain -= n / total * _entropy(held, n) + (total - n) / total * _entropy(other, total - n)
    return float(gain / _entropy(split, total))


@numba.njit(cache=True, nogil=True)
def _best_split(
    x: FloatArray, y: Ints, members: Ints, all_: FloatArray, skip: float, random: NDArray[np.uint64]
) -> tuple[int, int, float]:
    """Return feature, test and limit of the best split; feature -1 if none gains."""
    best, feature, test, limit = _NEGLIGIBLE, _LEAF, _GREATER, 0.0
    classes = len(all_)
    for f in range(x.shape[1]):
        column = np.empty(len(members))
        for i in range(len(members)):
            column[i] = x[members[i], f]
        order = np.argsort(column)
        if column[order[0]] == column[order[-1]]:
            continue
        below, equal = np.zeros(classes), np.zeros(classes)
        i = 0
        while i < len(order):
            value = column[order[i]]
            equal[:] = 0.0
            while i < len(order) and column[order[i]] == value:
                equal[y[members[order[i]]]] += 1
                i += 1
            smallest = below.sum() == 0
            below += equal
            if i == len(order):
                break
            if uniform(random) < skip:
                continue
            ratio = gain_ratio(all_ - below, all_)
            if ratio > best:
                best, feature, test, limit = ratio, f, _GREATER, value
            if smallest:
                continue
            ratio = gain_ratio(equal, all_)
            if ratio > best:
                best, feature, test, limit = ratio, f, _EQUAL, value
    return feature, test, limit


@numba.njit(cache=True, nogil=True)
def _parted(
    x: FloatArray, members: Ints, feature: int, test: int, limit: float
) -> tuple[Ints, Ints]:
    holds = np.empty(len(members), dtype=np.bool_)
    for i in range(len(members)):
        value = x[members[i], feature]
        holds[i] = value > limit if test == _GREATER else value == limit
    return members[holds], members[~holds]


@numba.njit(cache=True, nogil=True)
def _class_counts(y: Ints, members: Ints, classes: int) -> FloatArray:
    counts = np.zeros(classes)
    for i in members:
        counts[y[i]] += 1
    return counts


@numba.njit(cache=True, nogil=True)
def grow(
    x: FloatArray,
    y: Ints,
    members: Ints,
    newest: int,
    classes: int,
    skip: float,
    random: NDArray[np.uint64],
    nodes: Ints,
    limits: FloatArray,
    counts: FloatArray,
    used: int,
) -> int:
    """Rebuild one tree, keeping the branches that the newest experience does not reach.

    Returns
    -------
    int
        Number of nodes in use.
    """
    todo = [(0, members)]
    if used == 0:
        used = 1
        nodes[0, 0] = _LEAF
    keeping = True
    while len(todo) > 0:
        node, here = todo.pop()
        counts[node, :] = 0.0
        counts[node, :classes] = _class_counts(y, here, classes)
        pure = counts[node].max() == len(here)
        feature, test, limit = _LEAF, _GREATER, 0.0
        if not pure:
            feature, test, limit = _best_split(x, y, here, counts[node, :classes], skip, random)
        if feature == _LEAF:
            nodes[node, 0] = _LEAF
            keeping = False
            continue
        as_before = (
            keeping
            and nodes[node, 0] == feature
            and nodes[node, 1] == test
            and limits[node] == limit
        )
        held, other = _parted(x, here, feature, test, limit)
        if as_before:
            reached = x[newest, feature]
            holds = reached > limit if test == _GREATER else reached == limit
            child = nodes[node, 2]
            todo.append((child, held) if holds else (child + 1, other))
            continue
        keeping = False
        nodes[node, 0], nodes[node, 1], nodes[node, 2] = feature, test, used
        limits[node] = limit
        todo.append((used + 1, other))
        todo.append((used, held))
        used += 2
    return used
