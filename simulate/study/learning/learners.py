"""Replay of learners on a table of outcomes.

The default learner is the engine's own: the bandit of :mod:`grasp.learning.bandit` with the
evidence of :mod:`rtask.engine.memory.experience`. The thesis's formulation is :class:`GraspEnv`
with its four quadrants (Gatto 2016, 3.3.4).
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.agents import QLearning
from grasp.learning.agents.texplore import Texplore
from grasp.learning.bandit import Arm, BetaThompson, Trial
from grasp.learning.env import MAX_ATTEMPTS, GraspEnv, Outcome, Problem
from grasp.learning.environments.discretise import Bins
from grasp.learning.state import GrowingComponents
from grasp.learning.transition import Agent, Transition
from grasp.spatial.gripper import ParallelGripper
from rtask.engine.memory.experience import Weights, gather
from rtask.engine.policy import Policy
from rtask.engine.remembered import Remembered, Tally
from simulate.grasping.record import is_counted

__all__ = ["FAILED", "LEARNERS", "Learner", "replay"]

FAILED = MAX_ATTEMPTS + 1
"""Number of attempts counted for an object that no attempt held."""

_GRIPPER = ParallelGripper("hand", "hand", 0.0, 0.05)
_NOW = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
_STATE_RANGE, _STATE_PARTS = 3.0, 4
_TIE = 1e-6

Objects = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Learner:
    """A learner and the source of its grasps.

    Parameters
    ----------
    source
        Source of the grasps that it chooses from: ``geometry`` or ``blind``.
    run
        Takes the objects in order and a seed; yields attempts to first success of each.
    """

    name: str
    source: str
    run: Callable[[Objects, int, str], Iterator[int]]


def _arms(product: Mapping[str, Any], source: str) -> list[Mapping[str, Any]]:
    """Return the grasps of a source that the arm can reach."""
    return [a for a in product["arms"] if a["source"] == source and is_counted(a["reason"])]


def _bandit(
    objects: Objects, seed: int, source: str, *, prior: bool, memory: bool
) -> Iterator[int]:
    policy = Policy()
    if not prior:
        policy = replace(policy, bandit=replace(policy.bandit, kappa=0.0, selection="mean"))
    remembered: dict[str, list[Remembered]] = {}
    for number, product in enumerate(objects):
        of_kind = remembered.setdefault(product["kind"], [])
        similar = [g for g in of_kind if _alike(g, product, policy)] if memory else []
        tried, attempts = _episode(product, source, similar, policy, prior, (seed, number))
        of_kind.extend(_as_memory(product, arm, number) for arm in tried)
        yield attempts


def _episode(
    product: Mapping[str, Any],
    source: str,
    memory: Sequence[Remembered],
    policy: Policy,
    prior: bool,
    seed: tuple[int, int],
) -> tuple[list[Mapping[str, Any]], int]:
    """Return the grasps tried in order and the number of attempts to the first success."""
    arms = _arms(product, source)
    size = (float(product["size"][0]), float(product["size"][1]), float(product["size"][2]))
    rng = np.random.default_rng(seed)
    at = np.array([[a["x"], a["y"], a["z"]] for a in arms]).reshape(-1, 3)
    thetas = np.array([a["theta"] for a in arms])
    weights = Weights(policy, {}, _GRIPPER, size, _NOW)
    evidence = gather(at, thetas, memory, weights, policy.bandit.bandwidth)
    ties = _TIE * rng.random(
        len(arms)
    )  # without a prior all are equal at first: any may come first
    choices = [
        Arm(
            (a["x"], a["y"], a["z"]), a["theta"], a["quality"] if prior else None,
            float(evidence.successes[i] + ties[i]), float(evidence.failures[i]),
        )
        for i, a in enumerate(arms)
    ]  # fmt: skip
    learner = BetaThompson(policy.bandit, max(size))
    tried: list[Mapping[str, Any]] = []
    trials: list[Trial] = []
    while len(tried) < MAX_ATTEMPTS:
        ranked = [arms[c.index] for c in learner.rank(choices, trials, int(rng.integers(2**31)))]
        if not ranked:
            break
        arm = next((a for a in ranked if not a["doubtful"]), ranked[0])
        tried.append(arm)
        held = arm["reason"] == "ok"
        if held:
            return tried, len(tried)
        trials.append(Trial((arm["x"], arm["y"], arm["z"]), arm["theta"], held))
    return tried, FAILED


def _alike(grasp: Remembered, product: Mapping[str, Any], policy: Policy) -> bool:
    """Return whether the engine would consider an object of that size."""
    assert grasp.size is not None
    ratio = np.array(grasp.size) / np.array(product["size"])
    return bool(np.all(np.maximum(ratio, 1 / ratio) < policy.size_tolerance))


def _as_memory(product: Mapping[str, Any], arm: Mapping[str, Any], number: int) -> Remembered:
    length, width, height = (float(s) for s in product["size"])
    return Remembered(
        f"grasp:{number}", f"object:{number}", True, arm["x"], arm["y"], arm["z"], arm["theta"],
        _GRIPPER.max_opening, arm["quality"], _GRIPPER.gripper_type, (length, width, height),
        (Tally(arm["reason"] == "ok", 1),),
    )  # fmt: skip


def _random(objects: Objects, seed: int, source: str) -> Iterator[int]:
    rng = np.random.default_rng(seed)
    for product in objects:
        arms = _arms(product, source)
        order = [arms[i]["reason"] == "ok" for i in rng.permutation(len(arms))]
        yield order.index(True) + 1 if True in order[:MAX_ATTEMPTS] else FAILED


@dataclass(frozen=True)
class _Grasp:
    theta: float
    quality: float
    held: bool


def _quadrants(
    objects: Objects, seed: int, source: str, make: Callable[[Bins, int], Agent]
) -> Iterator[int]:
    bins = Bins((-_STATE_RANGE,) * 5, (_STATE_RANGE,) * 5, (_STATE_PARTS,) * 5)
    agent = make(bins, seed)
    components = GrowingComponents(seed=seed)
    rng = np.random.default_rng((seed, 2))
    for number, product in enumerate(objects):
        components.add(product["look"])
        state = np.clip(components.state(product["look"]).features, -_STATE_RANGE, _STATE_RANGE)
        problem = Problem(f"{number}", state, _both_ways(product, source, rng))
        if not problem.candidates:
            yield FAILED
            continue
        yield _steps(agent, GraspEnv([problem], _judge))


def _both_ways(product: Mapping[str, Any], source: str, rng: np.random.Generator) -> list[_Grasp]:
    """Return each grasp in its quadrant and in the opposite one, as two jaws are symmetric.

    In random order, which decides between grasps of one quality.
    """
    arms = _arms(product, source)
    return [
        _Grasp(
            a["theta"] + turn, a["quality"] if source == "geometry" else 0.0, a["reason"] == "ok"
        )
        for turn in (0.0, np.pi)
        for a in (arms[i] for i in rng.permutation(len(arms)))
    ]


def _judge(problem: Problem, candidate: Any) -> Outcome:
    return Outcome(candidate.held)


def _steps(agent: Agent, env: GraspEnv) -> int:
    """Let a learner act until the object is held; return the attempts."""
    state, info = env.reset()
    attempts = 0
    while True:
        action = agent.act(state, info)
        after, reward, ended, cut, info = env.step(action)
        attempts += not info["empty"]
        agent.observe(Transition(state, action, reward, after, ended, cut))
        if ended:
            return attempts
        if cut:
            return FAILED


class _AnyQuadrant:
    """Acts at random."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def act(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        mask = np.ones(4, bool) if info is None else info["action_mask"]
        return int(self._rng.choice(np.flatnonzero(mask)))

    def observe(self, transition: Transition) -> None:
        """Learn nothing."""


def _thesis(make: Callable[[Bins, int], Any]) -> Callable[[Objects, int, str], Iterator[int]]:
    return lambda objects, seed, source: _quadrants(objects, seed, source, make)


def _default(prior: bool, memory: bool) -> Callable[[Objects, int, str], Iterator[int]]:
    return lambda objects, seed, source: _bandit(objects, seed, source, prior=prior, memory=memory)


_q_learning = _thesis(lambda bins, seed: QLearning(bins, 4, seed=seed))
_texplore = _thesis(lambda bins, seed: Texplore(bins, 4, seed=seed))
_any_quadrant = _thesis(lambda bins, seed: _AnyQuadrant(seed))

LEARNERS: tuple[Learner, ...] = (
    Learner("bandit, geometry and graph", "geometry", _default(prior=True, memory=True)),
    Learner("bandit, geometry only", "geometry", _default(prior=True, memory=False)),
    Learner("four quadrants, Q-learning", "geometry", _q_learning),
    Learner("four quadrants, TEXPLORE", "geometry", _texplore),
    Learner("random", "geometry", _random),
    Learner("bandit, graph only", "blind", _default(prior=False, memory=True)),
    Learner("bandit, neither", "blind", _default(prior=False, memory=False)),
    Learner("four quadrants, Q-learning", "blind", _q_learning),
    Learner("four quadrants, TEXPLORE", "blind", _texplore),
    Learner("four quadrants, at random", "blind", _any_quadrant),
    Learner("random", "blind", _random),
)
"""The learners that are compared; for blind grasps, none of them uses a quality from geometry."""


def replay(
    objects: Objects, learner: Learner, seeds: Sequence[int]
) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """Replay a learner on all objects once per seed, in pairs of opposite orders.

    The second of a pair swaps the halves of the first, so that every object comes early as often as
    late and its difficulty does not affect the measured learning.

    Returns
    -------
    order : (s, n) int
        Objects in their order.
    attempts : (s, n) int
        Attempts up to the first success; :data:`FAILED` if none held.
    """
    orders: list[NDArray[np.intp]] = []
    counts = []
    for number, seed in enumerate(seeds):
        if number % 2 == 0:
            order = np.random.default_rng((seed, 1)).permutation(len(objects))
        else:
            order = np.roll(orders[-1], len(objects) // 2)
        orders.append(order)
        counts.append(list(learner.run([objects[i] for i in order], seed, learner.source)))
    return np.array(orders), np.array(counts)
