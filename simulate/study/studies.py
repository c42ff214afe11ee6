"""The experiments by name: settings and trials; light to import, the physics is in the workers."""

from __future__ import annotations

from grasp.learning.env import MAX_ATTEMPTS
from simulate.study.runner import Study

__all__ = ["grasping_study", "outcome_study"]


def grasping_study(
    trials: int,
    seed: int,
    max_attempts: int = 3,
    preset: str = "faithful",
    robot: str = "nao",
) -> Study:
    """Return the trials with perception in the loop: kinds in turn, after each round the arms."""
    return Study(
        "grasping with perception in the loop",
        "simulate.study.grasping:grasping_trial",
        {"seed": seed, "max_attempts": max_attempts, "preset": preset, "robot": robot},
        trials,
    )


def outcome_study(
    objects: int, seed: int, proposed: int = 3, blind: int = 6, preset: str = "faithful"
) -> Study:
    """Return the outcomes of so many proposed and so many blind grasps of each object.

    Where none of a sort holds more are tried, as many as a learner has attempts at most.
    """
    return Study(
        "outcomes of proposed and blind grasps",
        "simulate.study.outcomes:outcome_trial",
        {
            "seed": seed,
            "proposed": proposed,
            "blind": blind,
            "most": MAX_ATTEMPTS,
            "preset": preset,
        },
        objects,
    )
