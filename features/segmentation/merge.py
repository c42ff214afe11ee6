"""Patches joined into objects: connected components, or greedy contraction of a signed graph.

Greedy additive edge contraction (GAEC, Keuper et al. 2015) weighs all evidence along a border: a
few convex contacts do not glue two objects together whose border is mostly a valley.
"""

from __future__ import annotations

import heapq

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from features.segmentation.convexity import PatchGraph

__all__ = ["contract", "convex_components", "edge_weights"]

_SOFTNESS_DEG = 15.0


def convex_components(
    graph: PatchGraph, number: int, tolerance_deg: float, common_neighbours: int = 0
) -> NDArray[np.int64]:
    """Return the object (number,) of each patch: components over convex, smooth, sane edges.

    Parameters
    ----------
    common_neighbours
        Extended convexity: a kept edge needs so many patches that both its ends are joined to.
    """
    edges = (graph.angle_deg > -tolerance_deg) & graph.smooth & graph.sane
    pairs = graph.pairs[edges]
    if common_neighbours:
        ones = np.ones(len(pairs))
        half = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(number, number)).tocsr()
        both = half + half.T
        common = np.asarray((both @ both)[pairs[:, 0], pairs[:, 1]]).ravel()
        pairs = pairs[common >= common_neighbours]
    return np.asarray(_joined(pairs, number))


@numba.njit(cache=True, nogil=True)
def _root(parent, k):  # type: ignore[no-untyped-def]
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@numba.njit(cache=True, nogil=True)
def _numbered(parent):  # type: ignore[no-untyped-def]
    """Return the number (n,) of each root's tree, in the order of their least members."""
    labels, of_root = np.empty(parent.shape[0], np.int64), np.full(parent.shape[0], -1, np.int64)
    count = 0
    for k in range(parent.shape[0]):
        root = _root(parent, k)
        if of_root[root] < 0:
            of_root[root] = count
            count += 1
        labels[k] = of_root[root]
    return labels


@numba.njit(cache=True, nogil=True)
def _joined(pairs, number):  # type: ignore[no-untyped-def]
    """Return the connected part (number,) of each patch."""
    parent = np.arange(number)
    for k in range(pairs.shape[0]):
        a, b = _root(parent, pairs[k, 0]), _root(parent, pairs[k, 1])
        parent[max(a, b)] = min(a, b)
    return _numbered(parent)


def edge_weights(
    graph: PatchGraph,
    colours: NDArray[np.float64],
    tolerance_deg: float,
    bad_sanity: float,
    bad_smooth: float,
    colour_weight: float,
) -> NDArray[np.float64]:
    """Return how strongly each pair belongs together (e,): positive joins, negative parts."""
    return np.asarray(
        _weights(
            graph.pairs, graph.border, graph.angle_deg, graph.smooth, graph.sane, colours,
            tolerance_deg, bad_sanity, bad_smooth, colour_weight,
        )
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _weights(  # type: ignore[no-untyped-def]
    pairs, border, angle_deg, smooth, sane, colours, tolerance_deg, bad_sanity, bad_smooth, tinted
):
    weights = np.empty(pairs.shape[0])
    for k in range(pairs.shape[0]):
        quality = np.tanh((angle_deg[k] + tolerance_deg) / _SOFTNESS_DEG)
        if not sane[k]:
            quality = bad_sanity
        elif not smooth[k]:
            quality = min(quality, bad_smooth)
        tint = 0.0
        for c in range(3):
            tint += (colours[pairs[k, 0], c] - colours[pairs[k, 1], c]) ** 2
        weights[k] = border[k] * (quality - tinted * np.sqrt(tint))
    return weights


def contract(
    pairs: NDArray[np.int64], weights: NDArray[np.float64], number: int
) -> NDArray[np.int64]:
    """Return the object (number,) of each patch by greedy contraction.

    The heaviest positive edge is contracted, parallel edges are added up, until no edge is
    positive. Ties fall to the lower numbers, so that the same input gives the same objects.
    """
    return np.asarray(_contracted(pairs, weights, number))


@numba.njit(cache=True, nogil=True)
def _contracted(pairs, weights, number):  # type: ignore[no-untyped-def]
    """Contract edges. Half-edges 2 e and 2 e + 1 lead to the ends of edge e.

    The half-edges that leave a patch form a doubly linked list, so that merging two patches moves
    the links of one and forgets parallel edges, whose weights are added up.
    """
    edges = pairs.shape[0]
    towards, weight, alive = pairs.copy().ravel(), weights.copy(), np.ones(edges, np.bool_)
    # Links 0..number - 1 are the heads of the lists, half-edge h is link number + h.
    after, before = np.arange(number + 2 * edges), np.arange(number + 2 * edges)
    degree = np.zeros(number, np.int64)
    heap = [(0.0, np.int64(0), np.int64(0), np.int64(0)) for _ in range(0)]
    for h in range(2 * edges):
        _link(after, before, towards[h ^ 1], number + h)
        degree[towards[h ^ 1]] += 1
    for edge in range(edges):
        if weight[edge] > 0:
            heap.append((-weight[edge], pairs[edge, 0], pairs[edge, 1], np.int64(edge)))
    heapq.heapify(heap)
    parent, parallel = np.arange(number), np.full(number, -1, np.int64)
    while len(heap) > 0:
        negative, i, j, e = heapq.heappop(heap)
        a, b = towards[2 * e], towards[2 * e + 1]
        if not alive[e] or weight[e] != -negative or min(a, b) != i or max(a, b) != j:
            continue  # added to since, moved or gone
        if degree[i] < degree[j] or (degree[i] == degree[j] and i > j):
            i, j = j, i
        parent[j] = i
        link = after[i]
        while link != i:
            parallel[towards[link - number]] = (link - number) >> 1
            link = after[link]
        link = after[j]
        while link != j:
            following, h = after[link], link - number
            other, mine = towards[h], h >> 1
            if other == i or parallel[other] >= 0:
                alive[mine] = False
                _unlink(after, before, number + (h ^ 1))
                degree[other] -= 1
                if other != i:
                    weight[parallel[other]] += weight[mine]
                    mine = parallel[other]
            else:
                towards[h ^ 1] = i
                _unlink(after, before, link)
                _link(after, before, i, link)
                degree[i] += 1
            if other != i and weight[mine] > 0:
                heapq.heappush(heap, (-weight[mine], min(i, other), max(i, other), mine))
            link = following
        link = after[i]
        while link != i:
            parallel[towards[link - number]] = -1
            link = after[link]
        parallel[j] = -1
    return _numbered(parent)


@numba.njit(cache=True, nogil=True)
def _link(after, before, head, link):  # type: ignore[no-untyped-def]
    after[link], before[link] = after[head], head
    before[after[head]] = link
    after[head] = link


@numba.njit(cache=True, nogil=True)
def _unlink(after, before, link):  # type: ignore[no-untyped-def]
    after[before[link]], before[after[link]] = after[link], before[link]
