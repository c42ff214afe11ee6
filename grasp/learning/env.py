"""The grasp problem of Gatto 2016, 3.3.4 as a gymnasium environment.

State: five principal components of how the object looks, the same for the whole episode. Actions:
the four quadrants of the planar angle theta. The reward says whether the object was held. There are
no dynamics; candidates as arms (:mod:`grasp.learning.bandit`) learn faster, and this is here to
show it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from grasp.learning.registration import refuse_rendering

__all__ = ["Candidate", "GraspEnv", "Outcome", "Problem", "quadrant"]

QUADRANTS = 4
MAX_ATTEMPTS = 12
_FEATURES = 5


class Candidate(Protocol):
    """Properties of a grasp that the environment uses."""

    @property
    def theta(self) -> float:
        """Closing direction, rad."""

    @property
    def quality(self) -> float:
        """By geometry, larger is better."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of an attempt.

    Parameters
    ----------
    success
        The object was held; ``None``: nobody said (a person did not answer in time).
    confirmed_by
        ``physics``, ``human`` or ``data``.
    reason
        Reason code.
    """

    success: bool | None
    confirmed_by: Literal["physics", "human", "data"] = "physics"
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Problem:
    """An object to grasp.

    Parameters
    ----------
    name
        For people and for ``info``.
    features : (5,) float
        Of its view.
    candidates
        Grasps.
    """

    name: str
    features: NDArray[np.float64]
    candidates: Sequence[Candidate]

    def __post_init__(self) -> None:
        features = np.asarray(self.features, dtype=np.float64)
        if features.shape != (_FEATURES,) or not np.all(np.isfinite(features)):
            raise ValueError(f"{self.name}: expected {_FEATURES} finite features, got {features}")
        for number, candidate in enumerate(self.candidates):
            if not np.isfinite(candidate.quality) or not np.isfinite(candidate.theta):
                raise ValueError(f"{self.name}: candidate {number} is not finite")


def quadrant(theta: float) -> int:
    """Return which quarter of a turn an angle (rad) lies in.

    >>> [quadrant(np.radians(a)) for a in (0, 89, 90, 200, -1)]
    [0, 0, 1, 2, 3]
    """
    return int(np.floor(theta % (2 * np.pi) / (np.pi / 2) + 1e-12)) % QUADRANTS


class GraspEnv(gymnasium.Env[NDArray[np.float64], int]):
    """Try grasps of one object after another.

    An action takes the best candidate of its quadrant that was not tried in this episode; a
    quadrant without one costs as much as a failure, and no attempt is made. The episode ends with
    success and is cut off after twelve actions, or when nobody says what came of an attempt.

    Parameters
    ----------
    problems
        Objects, taken in this order again and again, from the first after a reset with a seed, or
        chosen by ``reset(options={"object": name})``.
    outcome
        Carries out a candidate of a problem and says what came of it.
    shuffled
        Each reset draws the object at random, so that environments side by side differ.

    render_mode
        None: there is no picture.

    Raises
    ------
    ValueError
        No objects, or two of the same name.
    gymnasium.error.UnsupportedMode
        A mode of rendering is asked for.
    """

    def __init__(
        self,
        problems: Sequence[Problem],
        outcome: Callable[[Problem, Candidate], Outcome],
        *,
        shuffled: bool = False,
        render_mode: str | None = None,
    ) -> None:
        refuse_rendering(render_mode)
        if not problems:
            raise ValueError("there is no object to grasp")
        names = [problem.name for problem in problems]
        if len(set(names)) < len(names):
            raise ValueError("two objects have the same name")
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (_FEATURES,), np.float64)
        self.action_space = gymnasium.spaces.Discrete(QUADRANTS)  # type: ignore[assignment]
        self._problems = {problem.name: problem for problem in problems}
        self._order = names
        self._next = 0
        self._shuffled = shuffled
        self._outcome = outcome
        self._attempts = 0
        self._start(problems[0])

    def _start(self, problem: Problem) -> None:
        self._problem = problem
        self._attempts = 0
        ranked = sorted(
            range(len(problem.candidates)), key=lambda i: (-problem.candidates[i].quality, i)
        )
        self._left: list[list[int]] = [[] for _ in range(QUADRANTS)]
        for index in ranked:
            self._left[quadrant(problem.candidates[index].theta)].append(index)

    def _info(self, **more: Any) -> dict[str, Any]:
        counts = np.array([len(left) for left in self._left])
        return {
            "object": self._problem.name,
            "candidates": len(self._problem.candidates),
            "left": counts,
            "action_mask": counts > 0 if counts.any() else np.ones(QUADRANTS, dtype=bool),
            **more,
        }

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Turn to the next object, or to ``options["object"]``; a seed restarts the order.

        Raises
        ------
        ValueError
            There is no such object.
        """
        super().reset(seed=seed)
        if seed is not None:
            self._next = 0
        name = (options or {}).get("object")
        if name is None:
            number = self._next
            if self._shuffled:
                number = int(self.np_random.integers(len(self._order)))
            name = self._order[number % len(self._order)]
            self._next += 1
        if name not in self._problems:
            raise ValueError(f"there is no object {name!r}")
        self._start(self._problems[name])
        return self._observation(), self._info()

    def _observation(self) -> NDArray[np.float64]:
        return np.array(self._problem.features, dtype=np.float64)

    def step(self, action: int) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Try the best candidate of a quadrant."""
        self._attempts += 1
        last = self._attempts >= MAX_ATTEMPTS
        left = self._left[int(action)]
        if not left:
            return self._observation(), -1.0, False, last, self._info(empty=True)
        index = left.pop(0)
        outcome = self._outcome(self._problem, self._problem.candidates[index])
        info = self._info(
            empty=False, candidate=index, reason=outcome.reason, confirmed_by=outcome.confirmed_by
        )
        if outcome.success is None:
            return self._observation(), 0.0, False, True, {**info, "unlabelled": True}
        reward = 1.0 if outcome.success else -1.0
        return self._observation(), reward, outcome.success, last and not outcome.success, info
