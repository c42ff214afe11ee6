"""Q-learning (Watkins 1989)."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from grasp.learning.agents.tabular import Settings, TabularAgent
from grasp.learning.environments.discretise import Bins
from grasp.learning.transition import Transition

__all__ = ["QLearning"]


class QLearning(TabularAgent):
    """Moves the value of what was done towards reward plus the best of what follows.

    Parameters
    ----------
    bins, actions, settings, seed
        As of every learner with a table.
    standard
        Choose the next action with what the last one taught, as in Sutton and Barto. Otherwise it
        is chosen just before, as in the published implementation that Gatto 2016 used: an action
        that leads nowhere (an illegal pick-up, a wall) is then often done twice.
    """

    def __init__(
        self,
        bins: Bins,
        actions: int,
        settings: Settings | None = None,
        seed: int = 0,
        *,
        standard: bool = False,
    ) -> None:
        super().__init__(bins, actions, settings, seed)
        self.standard = standard

    def parameters(self) -> dict[str, Any]:
        """Return what the learner was made with."""
        return {**super().parameters(), "standard": self.standard}

    def observe(self, transition: Transition) -> None:
        """Learn from one step."""
        after = self.bins.number(transition.next_state)
        if not (self.standard or transition.terminated or transition.truncated):
            self.plan(after)
        self._learn(self._cell_before(transition), transition, after)

    def learn_examples(self, transitions: Iterable[Transition]) -> None:
        """Learn from others' steps."""
        for transition in transitions:
            self.update(transition)

    def update(self, transition: Transition) -> tuple[int, int]:
        """Learn from one step; return the numbers of the state and the next one."""
        before = self.bins.number(transition.state)
        after = self.bins.number(transition.next_state)
        self._learn(before, transition, after)
        return before, after

    def _learn(self, before: int, transition: Transition, after: int) -> None:
        target = transition.reward
        if not transition.terminated:
            target += self._gamma * max(self._rows[after].tolist())
        row, action = self._rows[before], transition.action
        value = row.item(action)
        row[action] = value + self._alpha * (target - value)
