"""The thesis's formulation on simulated objects: four quadrants of the direction as actions.

:class:`grasp.learning.env.GraspEnv` (Gatto 2016, 3.3.4) with its own learners, some simpler ones,
and an oracle that shows how much the actions themselves allow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.learning.agents import QLearning, run_episode
from grasp.learning.agents.texplore import Texplore, TexploreSettings
from grasp.learning.contenders import Attempt, Luck, median_distance
from grasp.learning.env import (
    MAX_ATTEMPTS,
    QUADRANTS,
    Candidate,
    GraspEnv,
    Outcome,
    Problem,
    quadrant,
)
from grasp.learning.environments.discretise import Bins
from grasp.learning.simulated import FEATURES, World
from grasp.learning.transition import Learner, Transition

__all__ = [
    "QuadrantBelief", "QuadrantOracle", "Quadrants", "RandomQuadrant", "q_learning", "texplore",
]  # fmt: skip


@dataclass(frozen=True)
class _Numbered:
    """A candidate that knows its number among the object's."""

    number: int
    theta: float
    quality: float


class Quadrants:
    """A learner in the grasp environment.

    Parameters
    ----------
    world
        Of objects.
    seed
        Of the learner, and of the order of candidates within a quadrant.
    make
        Makes the learner, given the world and a seed.
    ranked
        Within a quadrant try the candidates by their good quality. Otherwise in any order, as
        those of Gatto 2016 carry no quality.
    """

    def __init__(
        self, world: World, seed: int, make: Callable[[World, int], Learner], ranked: bool = False
    ) -> None:
        rng = np.random.default_rng((seed, 11))
        problems = []
        # Half a cell off, so that four cells lie evenly around the mean of the views.
        views = np.clip(world.views + 0.5, -1.5, 2.5)
        for name, (item, view) in enumerate(zip(world.things, views, strict=True)):
            order = item.good if ranked else rng.random(len(item))
            grasps = [
                _Numbered(k, float(item.directions[k]), float(order[k])) for k in range(len(item))
            ]
            problems.append(Problem(str(name), view, grasps))
        self._env = GraspEnv(problems, self._try)
        self._learner = make(world, seed)
        self._luck = Luck(world, seed)
        self._tried: list[Attempt] = []

    def _try(self, problem: Problem, candidate: Candidate) -> Outcome:
        assert isinstance(candidate, _Numbered)
        held = self._luck.holds(int(problem.name), candidate.number, len(self._tried))
        self._tried.append(Attempt(candidate.number, held))
        return Outcome(held, "data")

    def grasp(self, number: int, luck: Luck, learn: bool = True) -> list[Attempt]:
        """Try until one holds or twelve attempts have failed; learns in any case."""
        self._luck, self._tried = luck, []
        options = {"object": str(number)}
        run_episode(self._learner, self._env, options=options, max_steps=MAX_ATTEMPTS)
        return self._tried


def _view_bins() -> Bins:
    """Return four cells for each of the five numbers of a view."""
    return Bins((-1,) * FEATURES, (2,) * FEATURES, (3,) * FEATURES)


def q_learning(world: World, seed: int) -> Learner:
    """Return Q-learning on 4^5 cells of the view."""
    return QLearning(_view_bins(), QUADRANTS, seed=seed)


def texplore(world: World, seed: int, bonus: float = 0.0) -> Learner:
    """Return TEXPLORE on the same cells; ``bonus`` weighs the disagreement of its trees."""
    settings = TexploreSettings(reward_range=2.0, rollouts=50, bonus=bonus)
    return Texplore(_view_bins(), QUADRANTS, settings, seed=seed)


class RandomQuadrant:
    """Takes any quadrant that has a candidate left."""

    def __init__(self, world: World, seed: int) -> None:
        self._rng = np.random.default_rng((seed, 19))

    def act(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        """Return a quadrant."""
        assert info is not None
        return int(self._rng.choice(np.flatnonzero(info["action_mask"])))

    def observe(self, transition: Transition) -> None:
        """Learn nothing."""


class QuadrantOracle:
    """Knows the mean chance of each quadrant's candidates and takes the best while it can."""

    def __init__(self, world: World, seed: int) -> None:
        self._means = [
            np.array([_mean(item.chances[_quadrants(item.directions) == q]) for q in range(4)])
            for item in world.things
        ]

    def act(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        """Return a quadrant."""
        assert info is not None
        means = np.where(info["action_mask"], self._means[int(info["object"])], -1.0)
        return int(np.argmax(means))

    def observe(self, transition: Transition) -> None:
        """Learn nothing."""


class QuadrantBelief:
    """Beta beliefs about the quadrants of the present object, one drawn from each.

    Parameters
    ----------
    world, seed
    shared
        What was tried on other objects counts too, fading with the distance of their views.
    """

    def __init__(self, world: World, seed: int, shared: bool = False) -> None:
        self._rng = np.random.default_rng((seed, 13))
        self._width = 0.5 * median_distance(world.views)
        self._shared = shared
        self._states: list[NDArray[Any]] = []
        self._tried: list[tuple[int, int]] = []
        self._own = np.zeros((QUADRANTS, 2))

    def act(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        """Return the quadrant of the largest draw."""
        assert info is not None
        belief = 1.0 + self._own + self._remembered(state)
        drawn = self._rng.beta(belief[:, 0], belief[:, 1])
        return int(np.argmax(np.where(info["action_mask"], drawn, -1.0)))

    def _remembered(self, state: NDArray[Any]) -> FloatArray:
        counts = np.zeros((QUADRANTS, 2))
        if self._states:
            apart = np.sum((np.array(self._states) - state) ** 2, axis=1)
            np.add.at(counts, tuple(np.array(self._tried).T), np.exp(-apart / (2 * self._width**2)))
        return counts

    def observe(self, transition: Transition) -> None:
        """Count one attempt."""
        pair = (transition.action, 0 if transition.terminated else 1)
        self._own[pair] += 1
        if transition.terminated or transition.truncated:
            self._own[:] = 0.0
        if self._shared:
            self._states.append(transition.state)
            self._tried.append(pair)


def _quadrants(directions: FloatArray) -> NDArray[np.int64]:
    return np.array([quadrant(float(d)) for d in directions])


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else -1.0
