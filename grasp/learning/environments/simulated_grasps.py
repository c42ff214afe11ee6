"""The grasp problem on simulated objects, ready to run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from grasp.learning.env import Candidate, GraspEnv, Outcome, Problem
from grasp.learning.registration import refuse_rendering
from grasp.learning.simulated import WorldSettings, make_world

__all__ = ["SimulatedGrasps", "grasp_environment"]


@dataclass(frozen=True)
class _Grasp:
    theta: float
    quality: float
    chance: float


class SimulatedGrasps(GraspEnv):
    """Grasp polygons of :mod:`grasp.learning.simulated`; outcomes are drawn from simulated pushes.

    Parameters
    ----------
    objects, families
        How many.
    world_seed
        Of the objects, which are the same for the same seed.
    quality
        Perception by which the candidates of a quadrant are ordered; ``None``: at random, as the
        candidates of Gatto 2016 carry no quality.
    shuffled
        As of :class:`~grasp.learning.env.GraspEnv`.
    """

    def __init__(
        self,
        objects: int = 12,
        families: int = 4,
        world_seed: int = 0,
        quality: Literal["good", "poor"] | None = None,
        shuffled: bool = True,
        *,
        render_mode: str | None = None,
    ) -> None:
        refuse_rendering(render_mode)  # before the objects are laid out, which takes 2 s
        if objects < 1 or families < 1:
            raise ValueError(f"expected objects and families, got {objects} and {families}")
        if quality not in (None, "good", "poor"):
            raise ValueError(f"quality is {quality!r}, expected 'good', 'poor' or None")
        world = make_world(WorldSettings(families=families, objects=objects, seed=world_seed))
        rng = np.random.default_rng((world_seed, 29))
        problems = []
        for number, (item, view) in enumerate(zip(world.things, world.views, strict=True)):
            ratings = rng.random(len(item)) if quality is None else getattr(item, quality)
            columns = (item.directions.tolist(), ratings.tolist(), item.chances.tolist())
            grasps = [_Grasp(*row) for row in zip(*columns, strict=True)]
            problems.append(Problem(str(number), view, grasps))
        super().__init__(problems, self._push, shuffled=shuffled)

    def _push(self, problem: Problem, candidate: Candidate) -> Outcome:
        assert isinstance(candidate, _Grasp)
        return Outcome(bool(self.np_random.random() < candidate.chance), "data")


def grasp_environment(
    problems: Sequence[Problem] | None = None,
    outcome: Callable[[Problem, Candidate], Outcome] | None = None,
    **options: Any,
) -> GraspEnv:
    """Return the environment registered as ``rtask/Grasp-v0``.

    Parameters
    ----------
    problems, outcome
        As of :class:`~grasp.learning.env.GraspEnv`; without them, simulated objects.
    **options
        Further arguments of that class, or of :class:`SimulatedGrasps`.

    Raises
    ------
    ValueError
        One of ``problems`` and ``outcome`` is missing.
    """
    if problems is None and outcome is None:
        return SimulatedGrasps(**options)
    if problems is None or outcome is None:
        missing = "problems" if problems is None else "outcome"
        raise ValueError(f"{missing} is missing: give problems and outcome, or neither of them")
    return GraspEnv(problems, outcome, **options)
