"""Running a learner in an environment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from grasp.learning.transition import Learner, Transition

__all__ = ["Episode", "run_episode", "run_episodes"]


@dataclass(frozen=True)
class Episode:
    """Result of an episode: the undiscounted sum of its rewards and its number of steps."""

    reward: float
    steps: int


def run_episode(
    agent: Learner,
    environment: gymnasium.Env[Any, Any],
    *,
    seed: int | None = None,
    max_steps: int = 1000,
    options: dict[str, Any] | None = None,
) -> Episode:
    """Let a learner act until the episode ends or ``max_steps`` have passed.

    Parameters
    ----------
    seed, options
        Of the environment's reset.
    """
    state, info = environment.reset(seed=seed, options=options)
    state, total = np.asarray(state), 0.0
    for step in range(1, max_steps + 1):
        action = agent.act(state, info)
        after, given, ended, cut, info = environment.step(action)
        reward, ended = float(given), bool(ended)
        cut = bool(cut) or (step == max_steps and not ended)
        if not isinstance(after, np.ndarray):
            after = np.asarray(after)
        agent.observe(Transition(state, action, reward, after, ended, cut))
        total += reward
        state = after
        if ended or cut:
            return Episode(total, step)
    return Episode(total, max_steps)


def run_episodes(
    agent: Learner, environment: gymnasium.Env[Any, Any], episodes: int, seed: int = 0
) -> Iterator[Episode]:
    """Yield one episode after another; the environment's dice are thrown from one seed."""
    for number in range(episodes):
        limit = getattr(environment.unwrapped, "max_steps", 1000)
        yield run_episode(agent, environment, seed=seed if number == 0 else None, max_steps=limit)
