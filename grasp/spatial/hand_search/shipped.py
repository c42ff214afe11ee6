"""The filters of grasp candidates that come with the package, one for each hand that is known here.

Each was trained on simulated views of generated shapes alone, and is made again by

    rtask study grasp-views views.npz --gripper HAND --shapes 40 --parts 100
    rtask grasp train views.npz --out MODELS/KEY.npz

where a model's file is named after its gripper's key (`gripper_key`), with a hyphen for the space.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Literal

from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.classifier import GraspClassifier, gripper_key

__all__ = ["Filter", "chosen_filter", "shipped_classifier"]

Filter = GraspClassifier | Literal["shipped"] | None
"""A model, the one that comes with the package for the gripper, or geometry alone."""

_MODELS = Path(__file__).parent / "models"


@lru_cache(maxsize=8)
def _stored(key: str) -> GraspClassifier | None:
    path = _MODELS / f"{key.replace(' ', '-')}.npz"
    return GraspClassifier.load(path) if path.is_file() else None


def shipped_classifier(gripper: ParallelGripper) -> GraspClassifier | None:
    """Return the model that comes with the package for a gripper; None = there is none.

    >>> from grasp.spatial.gripper import panda_hand, parallel_jaw
    >>> shipped_classifier(panda_hand()).gripper, shipped_classifier(parallel_jaw(0.05))
    ('panda_hand 80', None)
    """
    return _stored(gripper_key(gripper))


def chosen_filter(classifier: Filter, gripper: ParallelGripper) -> GraspClassifier | None:
    """Return the model that a choice means for a gripper.

    Raises
    ------
    ValueError
        No model comes with the package for it.
    """
    if classifier != "shipped":
        return classifier
    shipped = shipped_classifier(gripper)
    if shipped is None:
        raise ValueError(
            f"no filter comes with rtask for {gripper_key(gripper)!r}: train one with "
            "rtask grasp train"
        )
    return shipped
