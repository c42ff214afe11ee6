"""Candidates as arms: ways to choose the next grasp, each on the same objects with the same luck.

The learner is the bandit that the engine uses (:mod:`grasp.learning.bandit`); only the graph is
played by a list of what was tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.learning.bandit import Arm, BetaThompson, Policy, Trial, kernel
from grasp.learning.env import MAX_ATTEMPTS
from grasp.learning.logistic import LearnedQuality
from grasp.learning.simulated import Thing, World

__all__ = ["Attempt", "Candidates", "Contender", "Luck", "Oracle", "RandomCandidate"]


_PUSH = 2 * np.pi
_SAME_OBJECT, _SAME_FAMILY, _SIMILAR = 1.0, 0.7, 0.5


@dataclass(frozen=True)
class Attempt:
    """Candidate that was tried, and whether it held."""

    candidate: int
    success: bool


class Luck:
    """Decides every attempt in advance, so that all contenders meet the same fortune.

    Parameters
    ----------
    world
        Whose objects are grasped.
    seed
        Of the fortune.
    """

    def __init__(self, world: World, seed: int) -> None:
        self._chances = [item.chances for item in world.things]
        rng = np.random.default_rng((seed, 7))
        self._drawn = [rng.random((MAX_ATTEMPTS, len(item))) for item in world.things]

    def holds(self, number: int, candidate: int, attempt: int) -> bool:
        """Return whether a candidate holds when it is tried as the given attempt, from 0."""
        return bool(self._drawn[number][attempt, candidate] < self._chances[number][candidate])


class Contender(Protocol):
    """Grasps one object after another and may learn from each."""

    def grasp(self, number: int, luck: Luck, learn: bool = True) -> list[Attempt]:
        """Try until one holds or twelve attempts have failed.

        Parameters
        ----------
        number
            Number of the object in the world.
        luck
            Decides.
        learn
            Keep what is learned for other objects.
        """


class RandomCandidate:
    """Tries the candidates in any order, each once."""

    def __init__(self, world: World, seed: int) -> None:
        self._world = world
        self._rng = np.random.default_rng((seed, 17))

    def grasp(self, number: int, luck: Luck, learn: bool = True) -> list[Attempt]:
        """Try until one holds or twelve attempts have failed."""
        order = self._rng.permutation(len(self._world.things[number]))
        return _in_order(order, number, luck)


class Oracle:
    """Knows the chances, and tries the best candidate again and again."""

    def __init__(self, world: World, seed: int) -> None:
        self._world = world

    def grasp(self, number: int, luck: Luck, learn: bool = True) -> list[Attempt]:
        """Try until one holds or twelve attempts have failed."""
        best = int(np.argmax(self._world.things[number].chances))
        return _in_order(np.full(MAX_ATTEMPTS, best), number, luck)


def _in_order(order: NDArray[np.int64], number: int, luck: Luck) -> list[Attempt]:
    attempts: list[Attempt] = []
    for candidate in order[:MAX_ATTEMPTS].tolist():
        attempts.append(Attempt(candidate, luck.holds(number, candidate, len(attempts))))
        if attempts[-1].success:
            break
    return attempts


class Candidates:
    """The bandit over candidates, with or without a quality by geometry and a graph of outcomes.

    Parameters
    ----------
    world, seed
    quality
        Which quality is the prior; ``None``: none.
    graph
        Learn from what happened with other objects.
    learned
        Replace the poor quality by what logistic regression on the candidates' features predicts
        once that is better (:mod:`grasp.learning.logistic`).
    selection, top_k
        As of :class:`grasp.learning.bandit.Policy`.
    """

    def __init__(
        self,
        world: World,
        seed: int,
        *,
        quality: Literal["good", "poor"] | None,
        graph: bool,
        learned: bool = False,
        selection: Literal["auto", "thompson", "mean"] = "auto",
        top_k: int = 5,
    ) -> None:
        self._world, self._seed = world, seed
        self._quality = quality
        # Nobody gives up before twelve attempts, so that contenders stay comparable.
        policy = Policy(selection=selection, top_k=top_k, stop_below=0.0)
        self._learner = BetaThompson(policy, size_m=1.0, period=_PUSH)
        self._memory = Memory(world) if graph else None
        features = world.things[0].features.shape[1]
        self._model = LearnedQuality(features) if learned else None
        self._decisions = 0

    def grasp(self, number: int, luck: Luck, learn: bool = True) -> list[Attempt]:
        """Try until one holds or twelve attempts have failed."""
        here = self._world.things[number]
        arms = self._arms(number)
        trials: list[Trial] = []
        attempts: list[Attempt] = []
        while len(attempts) < MAX_ATTEMPTS and not (attempts and attempts[-1].success):
            self._decisions += 1
            seed = 100_003 * self._seed + self._decisions
            best = self._learner.rank(arms, trials, seed)[0].index
            held = luck.holds(number, best, len(attempts))
            attempts.append(Attempt(best, held))
            trials.append(Trial(arms[best].position, float(here.directions[best]), held))
        if learn:
            self._learn(number, attempts)
        return attempts

    def _learn(self, number: int, attempts: list[Attempt]) -> None:
        if self._memory is not None:
            self._memory.add(number, attempts)
        if self._model is not None:
            here = self._world.things[number]
            for tried in attempts:
                self._model.learn(
                    here.features[tried.candidate], float(here.poor[tried.candidate]), tried.success
                )

    def _rated(self, here: Thing) -> list[float | None]:
        if self._quality is None:
            return [None] * len(here)
        quality: FloatArray = getattr(here, self._quality)
        if self._model is not None:
            quality = self._model.rate(here.features, quality)
        return [float(q) for q in quality]

    def _arms(self, number: int) -> list[Arm]:
        here = self._world.things[number]
        counts = np.zeros((len(here), 2)) if self._memory is None else self._memory.counts(number)
        return [
            Arm(
                (float(place[0]), float(place[1]), 0.0), float(direction),
                q, float(won), float(lost),
            )
            for place, direction, q, (won, lost) in zip(
                here.places, here.directions, self._rated(here), counts, strict=True
            )
        ]  # fmt: skip


class Memory:
    """Plays the graph: what was tried on which object, weighted by how alike the objects are.

    An outcome counts 1 on the object itself, 0.7 on another of its family and 0.5 on any other,
    fading with the distance between their views.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._width = 0.5 * median_distance(world.views)
        self._numbers: list[int] = []
        self._candidates: list[int] = []
        self._held: list[bool] = []

    def add(self, number: int, attempts: list[Attempt]) -> None:
        """Remember the attempts on an object."""
        for attempt in attempts:
            self._numbers.append(number)
            self._candidates.append(attempt.candidate)
            self._held.append(attempt.success)

    def counts(self, number: int) -> FloatArray:
        """Return weighted successes and failures for each candidate, (n, 2)."""
        here = self._world.things[number]
        if not self._numbers:
            return np.zeros((len(here), 2))
        pairs = list(zip(self._numbers, self._candidates, strict=True))
        places = np.array([self._world.things[t].places[c] for t, c in pairs])
        directions = np.array([self._world.things[t].directions[c] for t, c in pairs])
        near = kernel(here.places, here.directions, places, directions, 1.0, period=_PUSH)
        held = np.array(self._held)
        weights = self._weights(number)
        won, lost = near @ (weights * held), near @ (weights * ~held)
        return np.round(np.stack([won, lost], axis=1), 9)

    def _weights(self, number: int) -> FloatArray:
        others = np.array(self._numbers)
        views, families = self._world.views, self._world.families()
        apart = np.sum((views[others] - views[number]) ** 2, axis=1)
        factor = np.where(families[others] == families[number], _SAME_FAMILY, _SIMILAR)
        factor[others == number] = _SAME_OBJECT
        weights: FloatArray = factor * np.exp(-apart / (2 * self._width**2))
        return weights


def median_distance(views: FloatArray) -> float:
    """Return the median distance between two objects' views (n, 5)."""
    apart = np.sqrt(np.sum((views[:, None] - views[None]) ** 2, axis=2))
    return float(np.median(apart[np.triu_indices(len(views), 1)])) if len(views) > 1 else 1.0
