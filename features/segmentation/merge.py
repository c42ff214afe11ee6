"""Patches joined into objects: connected components, or greedy contraction of a signed graph.

Greedy additive edge contraction (GAEC, Keuper et al. 2015) weighs all evidence along a border: a
few convex contacts do not glue two objects together whose border is mostly a valley.
"""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

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
    kept = (graph.angle_deg > -tolerance_deg) & graph.smooth & graph.sane
    pairs = graph.pairs[kept]
    if common_neighbours:
        ones = np.ones(len(pairs))
        half = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(number, number)).tocsr()
        both = half + half.T
        common = np.asarray((both @ both)[pairs[:, 0], pairs[:, 1]]).ravel()
        pairs = pairs[common >= common_neighbours]
    matrix = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(number, number))
    _, labels = connected_components(matrix, directed=False)
    return np.asarray(labels, np.int64)


def edge_weights(
    graph: PatchGraph,
    colours: NDArray[np.float64],
    tolerance_deg: float,
    bad_sanity: float,
    bad_smooth: float,
    colour_weight: float,
) -> NDArray[np.float64]:
    """Return how strongly each pair belongs together (e,): positive joins, negative parts."""
    quality = np.tanh((graph.angle_deg + tolerance_deg) / _SOFTNESS_DEG)
    quality = np.where(graph.smooth, quality, np.minimum(quality, bad_smooth))
    quality = np.where(graph.sane, quality, bad_sanity)
    tint = np.linalg.norm(colours[graph.pairs[:, 0]] - colours[graph.pairs[:, 1]], axis=1)
    weights: NDArray[np.float64] = graph.border * (quality - colour_weight * tint)
    return weights


def contract(
    pairs: NDArray[np.int64], weights: NDArray[np.float64], number: int
) -> NDArray[np.int64]:
    """Return the object (number,) of each patch by greedy contraction.

    The heaviest positive edge is contracted, parallel edges are added up, until no edge is
    positive. Ties fall to the lower numbers, so that the same input gives the same objects.
    """
    adjacent: list[dict[int, float]] = [{} for _ in range(number)]
    heap: list[tuple[float, int, int]] = []
    for (i, j), weight in zip(pairs.tolist(), weights.tolist(), strict=True):
        adjacent[i][j] = adjacent[j][i] = weight
        if weight > 0:
            heap.append((-weight, i, j))
    heapq.heapify(heap)
    parent = list(range(number))
    while heap:
        negative, i, j = heapq.heappop(heap)
        if adjacent[i].get(j) != -negative:
            continue  # an older weight of an edge that has been added to since, or is gone
        if (len(adjacent[i]), -i) < (len(adjacent[j]), -j):
            i, j = j, i
        parent[j] = i
        del adjacent[i][j]
        for other, weight in adjacent[j].items():
            if other == i:
                continue
            total = adjacent[i].get(other, 0.0) + weight
            adjacent[i][other] = adjacent[other][i] = total
            del adjacent[other][j]
            if total > 0:
                low, high = (i, other) if i < other else (other, i)
                heapq.heappush(heap, (-total, low, high))
        adjacent[j] = {}
    roots = np.array([_root(parent, k) for k in range(number)], np.int64)
    _, labels = np.unique(roots, return_inverse=True)
    return labels.astype(np.int64)


def _root(parent: list[int], k: int) -> int:
    while parent[k] != k:
        k = parent[k]
    return k
