"""Planar push grasps under uncertainty of shape and pose (Kehoe 2014, chapter 3).

Two flat parallel jaws: the first pushes a polygonal part until it lies flat against it, the second
closes. `plan_push_grasps` ranks candidates by a lower bound on the probability of force closure.
"""

from __future__ import annotations

from grasp.push.analysis import (
    Analysis,
    Elimination,
    Racing,
    analyse,
    running_best,
    stop_at,
)
from grasp.push.candidates import Grasps, make_grasps, sample_grasps
from grasp.push.inputs.sources import Outline, outline_from_cloud, read_outline, without_details
from grasp.push.mechanics.conditions import CODES
from grasp.push.perturb import Tolerance
from grasp.push.polygon import Part, as_part, as_polygon, simplify
from grasp.push.push_plan import PushPlan, analyse_push_grasps, plan_push_grasps
from grasp.push.shards import open_executor
from grasp.push.trials import PushTest

__all__ = [
    "CODES",
    "Analysis",
    "Elimination",
    "Grasps",
    "Outline",
    "Part",
    "PushPlan",
    "PushTest",
    "Racing",
    "Tolerance",
    "analyse",
    "analyse_push_grasps",
    "as_part",
    "as_polygon",
    "make_grasps",
    "open_executor",
    "outline_from_cloud",
    "plan_push_grasps",
    "read_outline",
    "running_best",
    "sample_grasps",
    "simplify",
    "stop_at",
    "warm_up",
    "without_details",
]


def warm_up() -> None:
    """Compile the kernels; they are kept on disk."""
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    for method in ("bound", "simulation"):
        plan_push_grasps(square, jaw_width=0.5, samples=1, method=method)
