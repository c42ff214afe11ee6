"""Learners of grasping side by side: the thesis's formulation, candidates as arms, priors.

Every contender meets the same objects in the same order with the same luck. Beside each result
stands an earlier measurement of the same rules in another, unrecorded, draw of families.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from grasp.learning.contenders import Candidates, Contender, Luck, Oracle, RandomCandidate
from grasp.learning.metrics import NEVER, Life
from grasp.learning.quadrants import (
    QuadrantBelief,
    QuadrantOracle,
    Quadrants,
    RandomQuadrant,
    q_learning,
    texplore,
)
from grasp.learning.simulated import World, WorldSettings, make_world
from grasp.workers import Processes

__all__ = ["ROWS", "Result", "Row", "compare", "transfer"]

UNSEEN_FAMILIES = 3


@dataclass(frozen=True)
class Row:
    """One contender.

    Parameters
    ----------
    name
        Shown.
    group
        ``quadrants`` or ``candidates``.
    make
        Makes it, given the world and a seed.
    reference
        Earlier measurement: attempts, first try, attempts at the first and last third of the
        objects, first try at the last third, attempts at families never met; ``None`` = unknown.
    """

    name: str
    group: str
    make: Callable[[World, int], Contender]
    reference: tuple[float | None, ...] = ()


def _arms(**chosen: Any) -> Callable[[World, int], Contender]:
    return partial(Candidates, **chosen)


def _quadrants(make: Any, ranked: bool = False) -> Callable[[World, int], Contender]:
    return partial(Quadrants, make=make, ranked=ranked)


_ALL = 10_000
_NONE, _GOOD, _POOR = ({"quality": q} for q in (None, "good", "poor"))

ROWS: tuple[Row, ...] = (
    Row("random", "quadrants", _quadrants(RandomQuadrant), (2.98, 0.33)),
    Row("Q-learning, 4^5 cells", "quadrants", _quadrants(q_learning), (2.94, 0.35)),
    Row("Beta, Thompson", "quadrants", _quadrants(QuadrantBelief), (2.91, 0.36)),
    Row("TEXPLORE", "quadrants", _quadrants(texplore), (3.18, None)),
    Row("TEXPLORE, variance bonus", "quadrants", _quadrants(partial(texplore, bonus=1.0)),
        (2.91, 0.40)),
    Row("Beta, prior by kernel over views", "quadrants",
        _quadrants(partial(QuadrantBelief, shared=True)), (2.89, 0.38, None, 2.75)),
    Row("oracle", "quadrants", _quadrants(QuadrantOracle), (2.31, 0.47)),
    Row("random, good quality within", "quadrants", _quadrants(RandomQuadrant, ranked=True)),
    Row("oracle, good quality within", "quadrants", _quadrants(QuadrantOracle, ranked=True)),
    Row("random", "candidates", RandomCandidate, (2.95, 0.35)),
    Row("nothing known, Thompson", "candidates",
        _arms(**_NONE, graph=False, selection="thompson", top_k=_ALL),
        (2.81, 0.35, 2.91, 2.70, 0.38, 3.13)),
    Row("good quality, Thompson", "candidates",
        _arms(**_GOOD, graph=False, selection="thompson", top_k=_ALL), (1.09, 0.92)),
    Row("good quality, mean", "candidates", _arms(**_GOOD, graph=False, selection="mean"),
        (1.06, 0.95)),
    Row("graph only, mean", "candidates", _arms(**_NONE, graph=True, selection="mean"),
        (1.54, 0.79, 1.89, 1.28, 0.89, 1.57)),
    Row("graph only, Thompson", "candidates",
        _arms(**_NONE, graph=True, selection="thompson", top_k=_ALL),
        (2.48, 0.38, 2.67, 2.30, None, None)),
    Row("graph only, Thompson of 5", "candidates",
        _arms(**_NONE, graph=True, selection="thompson"), (2.12, 0.54, 2.53, 1.79, None, 1.81)),
    Row("poor quality, mean", "candidates", _arms(**_POOR, graph=False, selection="mean"),
        (1.19, 0.87, 1.22, 1.19, 0.88, 1.11)),
    Row("poor and graph, mean", "candidates", _arms(**_POOR, graph=True, selection="mean"),
        (1.17, None, 1.20, 1.17, None, 1.14)),
    Row("poor and graph, Thompson of 5", "candidates",
        _arms(**_POOR, graph=True, selection="thompson"), (1.20, None, 1.24, 1.17, None, 1.16)),
    Row("poor and graph, Thompson", "candidates",
        _arms(**_POOR, graph=True, selection="thompson", top_k=_ALL),
        (1.23, None, 1.29, 1.24, None, None)),
    Row("good and graph, mean", "candidates", _arms(**_GOOD, graph=True, selection="mean"),
        (1.06, None, 1.07, 1.06, None, 1.05)),
    Row("good and graph, Thompson of 5", "candidates",
        _arms(**_GOOD, graph=True, selection="thompson"), (1.08, None, 1.10, 1.07, None, None)),
    Row("good and graph, Thompson", "candidates",
        _arms(**_GOOD, graph=True, selection="thompson", top_k=_ALL),
        (1.08, None, 1.10, 1.06, None, None)),
    Row("default, graph only", "candidates", _arms(**_NONE, graph=True)),
    Row("default, poor and graph", "candidates", _arms(**_POOR, graph=True)),
    Row("default, poor, learned, graph", "candidates",
        _arms(**_POOR, graph=True, learned=True)),
    Row("default, good and graph", "candidates", _arms(**_GOOD, graph=True)),
    Row("oracle", "candidates", Oracle, (1.00, 1.00)),
)  # fmt: skip


@dataclass(frozen=True)
class Result:
    """Results of one contender.

    Parameters
    ----------
    row
    lives
        On all objects in random order, one a seed.
    unseen
        On objects of families never met, after those of the others, one a seed; empty for
        quadrants.
    """

    row: Row
    lives: tuple[Life, ...]
    unseen: tuple[Life, ...]


def compare(
    rows: Iterable[Row] = ROWS,
    seeds: int = 20,
    worlds: int = 5,
    settings: WorldSettings | None = None,
    workers: int = 1,
) -> list[Result]:
    """Let every contender grasp the same objects.

    Parameters
    ----------
    rows
        Contenders.
    seeds
        Lives of each: orders of objects, luck, and whatever the contender draws.
    worlds
        Draws of families and objects; lives take them in turn.
    workers
        Processes.
    """
    chosen = tuple(rows)
    task = partial(_lives, chosen, worlds, settings or WorldSettings())
    if workers > 1:
        with Processes(workers) as pool:
            done = {seed: future.result() for seed, future in pool.finished(task, range(seeds))}
        results = [done[seed] for seed in range(seeds)]
    else:
        results = [task(seed) for seed in range(seeds)]
    return [
        Result(
            row,
            tuple(lives[k][0] for lives in results),
            tuple(life for lives in results if (life := lives[k][1]) is not None),
        )
        for k, row in enumerate(chosen)
    ]


def _lives(
    rows: Sequence[Row], worlds: int, settings: WorldSettings, seed: int
) -> list[tuple[Life, Life | None]]:
    world = make_world(replace(settings, seed=settings.seed + seed % worlds))
    order = np.random.default_rng((seed, 3)).permutation(len(world.things)).tolist()
    lives: list[tuple[Life, Life | None]] = []
    for row in rows:
        life = live(row.make(world, seed), world, order, seed)
        unseen = _unseen(row, world, order, seed) if row.group == "candidates" else None
        lives.append((life, unseen))
    return lives


def live(
    contender: Contender, world: World, order: Sequence[int], seed: int, learn: bool = True
) -> Life:
    """Let a contender grasp objects in an order."""
    luck = Luck(world, seed)
    needed, lost = [], []
    for number in order:
        tried = contender.grasp(number, luck, learn)
        needed.append(len(tried) if tried[-1].success else NEVER)
        chances = world.things[number].chances
        lost.append(sum(chances.max() - chances[attempt.candidate] for attempt in tried))
    return Life(np.array(order), np.array(needed), np.array(lost, dtype=np.float64))


def _unseen(row: Row, world: World, order: Sequence[int], seed: int) -> Life | None:
    """Learn from the other families, then grasp the objects of some, learning nothing more."""
    families = world.families()
    present = np.unique(families)
    if len(present) <= UNSEEN_FAMILIES:
        return None
    drawn = np.random.default_rng((seed, 5)).choice(present, UNSEEN_FAMILIES, replace=False)
    contender = row.make(world, seed)
    live(contender, world, [t for t in order if families[t] not in drawn], seed)
    return live(contender, world, [t for t in order if families[t] in drawn], seed, learn=False)


def transfer(
    seeds: int = 20, worlds: int = 5, settings: WorldSettings | None = None
) -> tuple[list[Life], list[Life]]:
    """Return lives of a robot that starts from another's outcomes, and of one that does not.

    Robot A has grasped all objects; robot B meets the same ones, with other luck, knowing nothing
    by geometry.
    """
    base = settings or WorldSettings()
    shared, alone = [], []
    for seed in range(seeds):
        world = make_world(replace(base, seed=base.seed + seed % worlds))
        rng = np.random.default_rng((seed, 3))
        order, again = (rng.permutation(len(world.things)).tolist() for _ in range(2))
        both = Candidates(world, seed, quality=None, graph=True)
        live(both, world, order, seed)
        shared.append(live(both, world, again, seed + seeds))
        fresh = Candidates(world, seed, quality=None, graph=True)
        alone.append(live(fresh, world, again, seed + seeds))
    return shared, alone
