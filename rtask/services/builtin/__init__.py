"""Services that come with the product, beside those of other packages."""

from __future__ import annotations

from rtask.services.builtin.grasping import Grasping
from rtask.services.builtin.pipeline import Pipeline
from rtask.services.builtin.push_trials import PushTrials
from rtask.services.builtin.segmentation import Segmentation
from rtask.services.builtin.space_plans import SpacePlans

__all__ = ["BUILTIN", "Grasping", "Pipeline", "PushTrials", "Segmentation", "SpacePlans"]

BUILTIN = (Segmentation, Grasping, Pipeline, PushTrials, SpacePlans)
