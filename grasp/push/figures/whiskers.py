"""Drawings of a plan: whiskers, best grasp, eliminated grasps (Kehoe 2014, Fig. 3.8 to 3.14).

A whisker starts at a nominal contact and runs outwards along the approach; its length is the
grasp's quality over the best one's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp.arrays import FloatArray
from grasp.push.figures.drawing import Canvas
from grasp.push.push_plan import PushPlan
from grasp.push.trials import Trials

__all__ = ["best_grasp_svg", "eliminated_svg", "whisker_segments", "whisker_svg"]

_LENGTH = 0.6
_OUTLINES = 20


def whisker_segments(plan: PushPlan) -> FloatArray:
    """Return the whiskers (g, 2, 2): nominal contact, outer end."""
    best = max(plan.quality, 1e-12)
    lengths = _LENGTH * plan.part.radius * plan.analysis.quality / best
    outer = plan.grasps.contacts - lengths[:, None] * plan.grasps.approaches
    return np.stack([plan.grasps.contacts, outer], axis=1)


def _canvas(plan: PushPlan, title: str) -> Canvas:
    reach = (_LENGTH + 0.2) * plan.part.radius
    ring = plan.part.vertices
    return Canvas(ring.min(axis=0) - reach, ring.max(axis=0) + reach, title=title)


def whisker_svg(
    plan: PushPlan, seed: int = 0, unit: str = "", holes: Sequence[FloatArray] = ()
) -> str:
    """Return the whisker diagram with perturbed outlines and tolerance circles of 2 sigma."""
    canvas = _canvas(plan, f"whiskers, best quality {plan.quality:.3f}")
    _perturbed(canvas, plan, seed)
    canvas.part(plan.part.vertices, holes)
    _tolerances(canvas, plan)
    for g, segment in enumerate(whisker_segments(plan)):
        if plan.analysis.quality[g] > 0:
            canvas.line(segment, "#1f77b4", 1)
        else:
            canvas.dot(segment[0], "#d62728", 1.5)
    canvas.line(whisker_segments(plan)[plan.best], "#d62728", 2.5)
    start, end = whisker_segments(plan)[plan.best]
    canvas.text(end + 0.08 * (end - start), f"{plan.quality:.2f}", size=13)
    canvas.key(
        {
            "whisker from a contact against the approach, as long as its quality": "#1f77b4",
            "best grasp; dots: no perturbed part closes; circles: two deviations of a vertex":
                "#d62728",
            "two deviations of the centre of mass": "#2ca02c",
            f"{_OUTLINES} perturbed outlines": "#bbb",
        },
        unit,
    )  # fmt: skip
    return canvas.svg()


def best_grasp_svg(
    plan: PushPlan, rank: int = 0, unit: str = "", holes: Sequence[FloatArray] = ()
) -> str:
    """Return a grasp with both jaws, before the push (dashed) and at the nominal contact."""
    index = int(plan.analysis.order[rank])
    quality = plan.analysis.quality[index]
    canvas = _canvas(plan, f"grasp {rank + 1}: quality {quality:.3f}")
    canvas.part(plan.part.vertices, holes)
    canvas.dot(plan.part.com, "#222", 4)
    jaw = plan.grasps.jaw(index, plan.test.jaw_width)
    along = plan.grasps.approaches[index]
    away = 0.4 * plan.part.radius * along
    far = jaw + plan.openings[index] * along
    canvas.line(jaw - away, "#2ca02c", 4, "6,4")
    canvas.line(jaw, "#2ca02c", 5)
    canvas.line(far + away, "#d62728", 4, "6,4")
    canvas.line(far, "#d62728", 5)
    canvas.line(np.stack([plan.grasps.contacts[index], plan.grasps.contacts[index] - away]), "#888")
    canvas.key(
        {
            "jaw that pushes; dashed: before": "#2ca02c",
            "jaw that closes; dashed: before": "#d62728",
            "nominal part, its centre of mass and the path of the jaw's corner": "#888",
        },
        unit,
    )
    return canvas.svg()


def eliminated_svg(plan: PushPlan, unit: str = "", holes: Sequence[FloatArray] = ()) -> str:
    """Return the whiskers with the eliminated candidates in red (Fig. 3.14)."""
    gone = plan.analysis.eliminated_after > 0
    canvas = _canvas(plan, f"{int(gone.sum())} of {len(gone)} candidates eliminated")
    canvas.part(plan.part.vertices, holes)
    for g, segment in enumerate(whisker_segments(plan)):
        canvas.line(segment, "#d62728" if gone[g] else "#1f77b4", 1)
        canvas.dot(segment[0], "#d62728" if gone[g] else "#1f77b4", 1.5)
    canvas.key({"eliminated, by its estimate then": "#d62728", "kept to the end": "#1f77b4"}, unit)
    return canvas.svg()


def _perturbed(canvas: Canvas, plan: PushPlan, seed: int) -> None:
    trials = Trials.of(plan.part, plan.grasps, plan.test, plan.tolerance, seed)
    vx, vy, _, _ = trials.parts(0, _OUTLINES)
    for k in range(_OUTLINES):
        ring = np.column_stack([vx[k], vy[k]]) * plan.part.radius + plan.part.centroid
        canvas.polygon(ring, "#bbb", "none", 0.7)


def _tolerances(canvas: Canvas, plan: PushPlan) -> None:
    spread = np.broadcast_to(np.asarray(plan.tolerance.vertex_std), (len(plan.part.vertices),))
    for vertex, sigma in zip(plan.part.vertices, spread, strict=True):
        if sigma > 0:
            canvas.ring(vertex, 2 * float(sigma))
    canvas.dot(plan.part.com, "#222", 4)
    if plan.tolerance.com_std > 0:
        canvas.ring(plan.part.com, 2 * plan.tolerance.com_std, "#2ca02c")
