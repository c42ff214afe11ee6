"""One step of experience, and what every learner of this room can do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

__all__ = ["Agent", "Learner", "Transition"]


# Made once a step: frozen, it would take ten times as long, checked after __init__ a fifth longer.
@dataclass(slots=True, eq=False, init=False)
class Transition:
    """Effect of an action.

    Parameters
    ----------
    state, next_state : (d,)
        Before and after.
    action
        Taken.
    reward
        Received.
    terminated
        The episode ended here by itself.
    truncated
        It was cut off.
    """

    state: NDArray[Any]
    action: int
    reward: float
    next_state: NDArray[Any]
    terminated: bool
    truncated: bool

    def __init__(
        self,
        state: NDArray[Any],
        action: int,
        reward: float,
        next_state: NDArray[Any],
        terminated: bool = False,
        truncated: bool = False,
    ) -> None:
        if not isfinite(reward):
            raise ValueError(f"reward of action {action} is {reward}")
        self.state, self.action, self.reward = state, action, reward
        self.next_state, self.terminated, self.truncated = next_state, terminated, truncated


class Learner(Protocol):
    """Protocol of a learner that acts and observes."""

    def act(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        """Return the action to take in a state (d,)."""

    def observe(self, transition: Transition) -> None:
        """Learn from one step."""


class Agent(Learner, Protocol):
    """A learner that can be put away and taken up again."""

    def learn_examples(self, transitions: Iterable[Transition]) -> None:
        """Learn from steps that somebody else took, before the first episode."""

    def save(self, path: Path) -> None:
        """Write everything that is needed to go on exactly here."""

    def load(self, path: Path) -> None:
        """Go on where :meth:`save` stopped."""
