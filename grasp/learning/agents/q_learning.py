"""Q-learning (Watkins 1989)."""

from __future__ import annotations

from grasp.learning.agents.tabular import TabularAgent
from grasp.learning.transition import Transition

__all__ = ["QLearning"]


class QLearning(TabularAgent):
    """Moves the value of what was done towards reward plus the best of what follows."""

    def observe(self, transition: Transition) -> None:
        """Learn from one step."""
        self.update(transition)

    def update(self, transition: Transition) -> tuple[int, int]:
        """Learn from one step; return the numbers of the state and the next one."""
        before = self.bins.number(transition.state)
        after = self.bins.number(transition.next_state)
        target = transition.reward
        if not transition.terminated:
            target += self.settings.gamma * self.values[after].max()
        value = self.values[before, transition.action]
        self.values[before, transition.action] = value + self.settings.alpha * (target - value)
        return before, after
