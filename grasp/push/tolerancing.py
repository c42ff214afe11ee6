"""Limits and costs of tolerances (Kehoe 2014, 3.5 and 6.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray, IntArray
from grasp.push.analysis import Elimination, analyse
from grasp.push.candidates import Grasps
from grasp.push.perturb import Tolerance
from grasp.push.polygon import Part
from grasp.push.quality import lower_bound
from grasp.push.trials import PushTest, Trials

__all__ = [
    "Optimum",
    "ToleranceLimit",
    "near_vertices",
    "optimise_tolerance",
    "quality_at",
    "tolerance_limit",
]

_GRID, _BISECTIONS = 16, 12
_CELLS = 9
_ZOOMS = 3


@dataclass(frozen=True)
class ToleranceLimit:
    """The largest deviation of a group of vertices at which a grasp is good enough.

    Parameters
    ----------
    limit
        Standard deviation; nan when not even the smallest tried is good enough.
    crossings
        How often the grid crosses the threshold; more than one: quality does not fall steadily and
        ``limit`` is the first crossing.
    sigmas, quality, lower_95 : (16,)
        The grid.
    unlimited
        The largest deviation tried is still good enough.
    """

    limit: float
    crossings: int
    sigmas: FloatArray
    quality: FloatArray
    lower_95: FloatArray
    unlimited: bool


def near_vertices(part: Part, grasps: Grasps, index: int, jaw_width: float) -> NDArray[np.bool_]:
    """Return which vertices (n,) belong to the edge that a grasp touches first.

    The success of the push depends on them and on the centre of mass, that of closing on the others
    (Kehoe 2014, 3.5).
    """
    ring = part.vertices
    after = np.roll(ring, -1, axis=0)
    along = after - ring
    t = ((grasps.contacts[index] - ring) * along).sum(axis=1) / (along**2).sum(axis=1)
    foot = ring + np.clip(t, 0, 1)[:, None] * along
    edge = int(np.argmin(np.hypot(*(grasps.contacts[index] - foot).T)))
    near = np.zeros(len(ring), bool)
    near[[edge, (edge + 1) % len(ring)]] = True
    return near


def quality_at(
    part: Part, grasps: Grasps, test: PushTest, tolerance: Tolerance, samples: int, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Return qualities (g,) and their lower 95 % bounds on the same draws for every tolerance."""
    wins = (Trials.of(part, grasps, test, tolerance, seed)(0, samples) > 0).sum(axis=1)
    return wins / samples, lower_bound(wins, np.full(len(wins), samples))


def tolerance_limit(
    part: Part,
    grasp: Grasps,
    test: PushTest,
    *,
    raised: NDArray[np.bool_],
    base_std: float,
    threshold: float,
    max_std: float | None = None,
    samples: int = 1000,
    seed: int = 0,
) -> ToleranceLimit:
    """Find the largest deviation of some vertices at which Q >= threshold with 95 % confidence.

    Parameters
    ----------
    grasp
        One grasp.
    raised : (n,) bool
        Vertices whose deviation is raised; the others keep ``base_std``. The centre of mass is the
        centroid of each perturbed part.
    max_std
        End of the search, default half a radius.
    """
    if len(grasp) != 1:
        raise ValueError(f"expected one grasp, got {len(grasp)}")
    if not 0 < threshold < 1:
        raise ValueError(f"threshold must lie between 0 and 1, got {threshold}")
    if not base_std > 0:
        raise ValueError(f"base_std must be positive, got {base_std}")
    end = 0.5 * part.radius if max_std is None else max_std
    if not end > 1e-3 * part.radius:
        raise ValueError(f"max_std must exceed a thousandth of the radius, got {max_std}")

    def bound(sigma: float) -> tuple[float, float]:
        spread = np.where(raised, sigma, base_std)
        tolerance = Tolerance(spread, com_follows=True)
        quality, low = quality_at(part, grasp, test, tolerance, samples, seed)
        return float(quality[0]), float(low[0])

    # The bound need not fall steadily: the grid shows crossings that bisection alone would miss.
    sigmas = np.geomspace(1e-3 * part.radius, end, _GRID)
    values = np.array([bound(sigma) for sigma in sigmas])
    good = values[:, 1] >= threshold
    crossings = int((good[1:] != good[:-1]).sum())
    if not good[0]:
        limit = float("nan")
    elif good.all():
        limit = float(end)
    else:
        k = int(np.argmin(good))
        low, high = float(sigmas[k - 1]), float(sigmas[k])
        for _ in range(_BISECTIONS):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if bound(middle)[1] >= threshold else (low, middle)
        limit = low
    return ToleranceLimit(limit, crossings, sigmas, values[:, 0], values[:, 1], bool(good.all()))


Cost = Callable[[FloatArray], float]


@dataclass(frozen=True)
class Optimum:
    """The cheapest grasp and tolerance (Kehoe 2014, 6.2).

    Parameters
    ----------
    grasp
        Index of g*.
    std : (3,)
        Deviations of near vertices, far vertices, and the centre of mass.
    quality, lower_95
        Of g* there.
    objective
        c_F (1 - Q) + cost.
    grid_near, grid_far : (9,); grid : (9, 9)
        Objective over the user's range, rows = near.
    grid_grasp : (9, 9) int
        The best grasp of each grid point.
    equal : (k, 2)
        Grid points (near, far) whose objective is within the noise of the smallest.
    near_range, far_range
        Deviations along each axis between which g* remains the best grasp.
    """

    grasp: int
    std: tuple[float, float, float]
    quality: float
    lower_95: float
    objective: float
    grid_near: FloatArray
    grid_far: FloatArray
    grid: FloatArray
    grid_grasp: IntArray
    equal: FloatArray
    near_range: tuple[float, float]
    far_range: tuple[float, float]


@dataclass(frozen=True)
class _Search:
    part: Part
    grasps: Grasps
    test: PushTest
    near: NDArray[np.bool_]
    com_std: float
    failure_cost: float
    cost: Cost
    seed: int

    def at(self, near: float, far: float, keep: IntArray, samples: int) -> tuple[float, int, float]:
        """Return objective, best grasp and its quality; every grasp has its own near edge."""
        best_wins, best = -1, int(keep[0])
        groups, where = np.unique(self.near[keep], axis=0, return_inverse=True)
        for k, group in enumerate(groups):
            mine = keep[where.ravel() == k]
            tolerance = Tolerance(np.where(group, near, far), self.com_std)
            task = Trials.of(self.part, self.grasps.take(mine), self.test, tolerance, self.seed)
            wins = (task(0, samples) > 0).sum(axis=1)
            top = int(np.argmax(wins))
            if wins[top] > best_wins:
                best_wins, best = int(wins[top]), int(mine[top])
        quality = best_wins / samples
        spent = float(self.cost(np.array([near, far, self.com_std])))
        return self.failure_cost * (1 - quality) + spent, best, quality


def _cost(kind: str | Cost, weights: Sequence[float]) -> Cost:
    w = np.asarray(weights, dtype=np.float64)
    if callable(kind):
        return kind
    if w.shape != (3,) or not np.all(np.isfinite(w)):
        raise ValueError("weights are three numbers: near vertices, far vertices, centre of mass")
    if kind == "inverse":
        if np.any(w < 0):
            raise ValueError("weights of the inverse cost are at least 0")
        return lambda std: float((w[std > 0] / std[std > 0]).sum())
    if kind == "linear":
        if np.any(w > 0):
            raise ValueError("tighter tolerances cost more: weights of the linear cost are <= 0")
        return lambda std: float((w * std).sum())
    raise ValueError(f"cost is inverse, linear or a callable, got {kind!r}")


def optimise_tolerance(
    part: Part,
    grasps: Grasps,
    test: PushTest,
    *,
    failure_cost: float,
    weights: Sequence[float] = (1.0, 1.0, 0.0),
    cost: str | Cost = "inverse",
    limits: tuple[float, float] | None = None,
    com_std: float = 0.0,
    samples: int = 1000,
    seed: int = 0,
) -> Optimum:
    """Find grasp and tolerance of the least total cost (Kehoe 2014, 6.2).

    Parameters
    ----------
    failure_cost
        c_F, of one failed grasp.
    weights : (3,)
        Of the tolerances of near vertices, far vertices, centre of mass.
    cost
        ``inverse``: sum of weight / deviation (default). ``linear``: sum of weight times deviation
        with weights <= 0; the printed term C Sigma with positive entries would make tight
        tolerances free. Or a function of the deviations (3,).
    limits
        Range of the deviations, default .005 to .2 radii.

    Notes
    -----
    A 9 x 9 logarithmic grid on 200 common draws with the candidates that elimination leaves at the
    corners and the centre; then three zooms by 3 around the best cell with ``samples`` draws.
    """
    if not (np.isfinite(failure_cost) and failure_cost >= 0):
        raise ValueError(f"failure_cost must be at least 0, got {failure_cost}")
    low, high = limits or (0.005 * part.radius, 0.2 * part.radius)
    if not 0 < low < high < np.inf:
        raise ValueError(f"limits must satisfy 0 < low < high, got {limits}")
    near = np.array([near_vertices(part, grasps, g, test.jaw_width) for g in range(len(grasps))])
    search = _Search(
        part, grasps, test, near, com_std, failure_cost, _cost(cost, weights), seed
    )  # fmt: skip
    axis = np.geomspace(low, high, _CELLS)
    keep = _promising(search, axis[[0, -1, _CELLS // 2]])
    cells = [[search.at(a, b, keep, 200) for b in axis] for a in axis]
    grid = np.array([[cell[0] for cell in row] for row in cells])
    owner = np.array([[cell[1] for cell in row] for row in cells])
    i, j = np.unravel_index(int(np.argmin(grid)), grid.shape)
    q = cells[i][j][2]
    # One standard error of the quality, which is not 0 where every draw succeeded.
    noise = failure_cost * np.sqrt(max(q * (1 - q), 1 / 200) / 200)
    rows, columns = np.nonzero(grid <= grid[i, j] + noise)
    a, b, value, grasp = _zoom(search, float(axis[i]), float(axis[j]), keep, (low, high), samples)
    quality, bound = quality_at(
        part, grasps.take([grasp]), test,
        Tolerance(np.where(near[grasp], a, b), com_std), samples, seed,
    )  # fmt: skip
    return Optimum(
        grasp, (a, b, com_std), float(quality[0]), float(bound[0]), value, axis, axis, grid, owner,
        np.column_stack([axis[rows], axis[columns]]),
        _reach(search, lambda s: (s, b), a, grasp, keep, (low, high), samples),
        _reach(search, lambda s: (a, s), b, grasp, keep, (low, high), samples),
    )  # fmt: skip


def _promising(search: _Search, sigmas: FloatArray) -> IntArray:
    """Return the candidates that elimination leaves at the corners and the centre of the range."""
    promising: set[int] = set()
    low, high, middle = sigmas
    share = 1 - min(1.0, 12 / len(search.grasps))
    for near, far in ((low, low), (low, high), (high, low), (high, high), (middle, middle)):
        # Each grasp has near vertices of its own: one look at all takes the mean for any of them.
        spread = np.where(search.near.any(axis=0), np.sqrt(near * far), far)
        analysis = analyse(
            search.part, search.grasps, search.test, Tolerance(spread, search.com_std),
            elimination=Elimination((20, 40), share), seed=search.seed,
        )  # fmt: skip
        promising.update(np.flatnonzero(analysis.eliminated_after == 0).tolist())
    return np.array(sorted(promising))


def _zoom(
    search: _Search, a: float, b: float, keep: IntArray, limits: tuple[float, float], samples: int
) -> tuple[float, float, float, int]:
    """Return near and far deviation, objective and grasp after three finer looks."""
    ratio = (limits[1] / limits[0]) ** (1 / (_CELLS - 1))
    value, grasp, _ = search.at(a, b, keep, samples)
    for _ in range(_ZOOMS):
        ratio = ratio ** (1 / 3)
        before = value
        centre = (a, b)
        for i in range(-3, 4):
            for j in range(-3, 4):
                s = float(np.clip(centre[0] * ratio**i, *limits))
                t = float(np.clip(centre[1] * ratio**j, *limits))
                tried = search.at(s, t, keep, samples)
                if tried[0] < value:
                    (value, grasp, _), a, b = tried, s, t
        if before - value < 0.01 * abs(before):
            break
    return a, b, value, grasp


def _reach(
    search: _Search, place: Callable[[float], tuple[float, float]], start: float, grasp: int,
    keep: IntArray, limits: tuple[float, float], samples: int,
) -> tuple[float, float]:  # fmt: skip
    """Return the range of a deviation around ``start`` in which ``grasp`` stays the best."""
    ends = []
    for limit in limits:
        if search.at(*place(limit), keep, samples)[1] == grasp:
            ends.append(limit)
            continue
        inside, outside = start, limit
        for _ in range(6):
            middle = float(np.sqrt(inside * outside))
            same = search.at(*place(middle), keep, samples)[1] == grasp
            inside, outside = (middle, outside) if same else (inside, middle)
        ends.append(inside)
    return ends[0], ends[1]
