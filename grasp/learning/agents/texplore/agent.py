"""TEXPLORE, one decision after another."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.agents.tabular import allowed_actions, load_arrays, save_arrays
from grasp.learning.agents.texplore.model import Model, Prediction
from grasp.learning.agents.texplore.tree import ForestSettings
from grasp.learning.agents.texplore.uct import Planner
from grasp.learning.environments.discretise import Bins
from grasp.learning.transition import Transition

__all__ = ["Texplore", "TexploreSettings"]


@dataclass(frozen=True)
class TexploreSettings:
    """Parameters of TEXPLORE.

    Parameters
    ----------
    gamma
        Discount a step.
    fading
        Lambda of the planner's returns.
    reward_range
        Largest reward less smallest.
    rollouts
        A decision.
    bonus, novelty
        Weights of exploration: the forests' disagreement, and distance to what was visited.
    forest
        How the model's trees grow.
    """

    gamma: float = 0.99
    fading: float = 0.1
    reward_range: float = 1.0
    rollouts: int = 200
    bonus: float = 0.0
    novelty: float = 0.0
    forest: ForestSettings = field(default_factory=ForestSettings)

    def __post_init__(self) -> None:
        if not 0 <= self.gamma < 1 or not 0 <= self.fading <= 1:
            raise ValueError(f"gamma {self.gamma} or fading {self.fading} is out of range")
        if self.rollouts < 1:
            raise ValueError(f"{self.rollouts} rollouts find no action")


class Texplore:
    """Learns a model by trees and plans by rollouts; the same seed gives the same life.

    Parameters
    ----------
    bins
        Numbers the states.
    actions
        How many there are.
    settings
        Parameters.
    seed
        Of everything random.
    """

    def __init__(
        self, bins: Bins, actions: int, settings: TexploreSettings | None = None, seed: int = 0
    ) -> None:
        self.settings = chosen = settings or TexploreSettings()
        self.bins, self.actions = bins, actions
        self.rng = np.random.default_rng(seed)
        self.model = Model(
            bins.low.tolist(), bins.high.tolist(), actions, chosen.forest, seed,
            bonus=chosen.bonus, novelty=chosen.novelty,
        )  # fmt: skip
        self.planner = Planner(
            bins, actions, chosen.reward_range, chosen.gamma, chosen.fading, seed
        )
        self._centres = bins.centres()
        self.predictions = Prediction(bins.count, actions, len(bins.low))

    def act(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        """Plan from a state (d,) and return the best action found; ties at random."""
        where = np.asarray(state, dtype=np.float64)
        self.planner.rollouts(where, self.settings.rollouts, self.predictions, self.predict)
        return self.best(where, info)

    def best(self, state: NDArray[Any], info: Mapping[str, Any] | None = None) -> int:
        """Return the best action known without planning."""
        # a copy: a planner that works in another thread may write between the two readings below
        values = self.planner.values[self.bins.number(state)].copy()
        mask = allowed_actions(info)
        if mask is not None:
            values = np.where(mask, values, -np.inf)
        return int(self.rng.choice(np.flatnonzero(values == values.max())))

    def predict(self, cell: int, action: int) -> None:
        """Fill a gap in the predictions."""
        self.model.predict_into(self.predictions, cell, self._centres[cell], action)

    def observe(self, transition: Transition) -> None:
        """Learn from one step."""
        if self.model.learn(transition):
            self.model_changed()

    def model_changed(self) -> None:
        """Forget what the model predicted before."""
        self.predictions.known[:] = False
        self.planner.model_changed()

    def learn_examples(self, transitions: Iterable[Transition]) -> None:
        """Learn from steps that somebody else took."""
        for transition in transitions:
            self.observe(transition)

    def save(self, path: Path) -> None:
        """Write everything that is needed to go on exactly here."""
        arrays = {
            **self.model.arrays(),
            "values": self.planner.values,
            "visits": self.planner.visits,
            "tries": self.planner.tries,
            "rollout_random": self.planner.random,
        }
        save_arrays(path, "Texplore", self.rng, asdict(self.settings), arrays)

    def load(self, path: Path) -> None:
        """Go on where :meth:`save` stopped.

        Raises
        ------
        ValueError
            Another learner's file, one of another version, or of other states, actions or
            settings. The learner is left as it was.
        """
        shape = self.planner.values.shape
        settings = asdict(self.settings)
        arrays = load_arrays(path, "Texplore", self.rng, settings, values=shape)
        self.model.take(arrays)
        self.planner.values = arrays["values"]
        self.planner.visits = arrays["visits"]
        self.planner.tries = arrays["tries"]
        self.planner.random = arrays["rollout_random"]
        self.predictions.known[:] = False
