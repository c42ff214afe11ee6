"""All figures of a plan, by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp.arrays import FloatArray
from grasp.charts import curve_chart, heat_map
from grasp.push.figures.drawing import Canvas
from grasp.push.figures.whiskers import best_grasp_svg, eliminated_svg, whisker_svg
from grasp.push.perturb import Tolerance
from grasp.push.pose import pose_map
from grasp.push.push_plan import PushPlan
from grasp.push.tolerancing import near_vertices, quality_at

__all__ = ["album", "candidates_3d_svg", "pose_svg", "tolerance_svg"]

_FACTORS = np.linspace(0.0, 3.0, 13)


def album(
    plan: PushPlan,
    height: float = 0.0,
    seed: int = 0,
    unit: str = "",
    holes: Sequence[FloatArray] = (),
) -> dict[str, str]:
    """Return SVG documents by name.

    Parameters
    ----------
    height
        Of the part over its support; drawn in space when it is known.
    unit
        Of the part's lengths, where it is known.
    holes
        Each (m, 2): of the part, in its unit; none by default.
    """
    drawings = {
        "whiskers": whisker_svg(plan, seed, unit, holes),
        "best": best_grasp_svg(plan, unit=unit, holes=holes),
        "tolerance": tolerance_svg(plan, seed=seed, unit=unit),
        "pose": pose_svg(plan, seed=seed, unit=unit),
    }
    if np.any(plan.analysis.eliminated_after):
        drawings["eliminated"] = eliminated_svg(plan, unit, holes)
    if height > 0:
        drawings["candidates_3d"] = candidates_3d_svg(plan, height, holes=holes)
    return drawings


def tolerance_svg(plan: PushPlan, samples: int = 400, seed: int = 0, unit: str = "") -> str:
    """Return the best grasp's quality as either group of tolerances is raised, with 95 % bands."""
    near = near_vertices(plan.part, plan.grasps, plan.best, plan.test.jaw_width)
    base = np.broadcast_to(np.asarray(plan.tolerance.vertex_std), near.shape)
    if not base.any():
        base = np.full(near.shape, 0.01 * plan.part.radius)
    grasp = plan.grasps.take(plan.best)
    curves: dict[str, FloatArray] = {}
    for name, raised in (("near edge", near), ("others", ~near)):
        spreads = [np.where(raised, base * factor, base) for factor in _FACTORS]
        values = [
            quality_at(
                plan.part, grasp, plan.test, Tolerance(s, plan.tolerance.com_std), samples, seed
            )
            for s in spreads
        ]
        curves[name] = np.array([q[0] for q, _ in values])
        curves[f"{name}, lower 95 %*"] = np.array([low[0] for _, low in values])
    title = f"best grasp under looser tolerances, {samples} perturbed parts"
    label = f"standard deviation of vertices, times {base.mean():.3g} {unit}".rstrip()
    return curve_chart(_FACTORS, curves, title, label, (0.0, 1.0), "quality")


def pose_svg(plan: PushPlan, samples: int = 60, seed: int = 0, unit: str = "") -> str:
    """Return the best grasp's simulated quality over uncertain position and rotation."""
    positions = np.linspace(0.02, 0.3, 8) * plan.part.diameter
    rotations = np.deg2rad(np.linspace(2.0, 40.0, 8))
    grasp = plan.grasps.take(plan.best)
    table = pose_map(plan.part, grasp, plan.test, positions, rotations, samples=samples, seed=seed)
    return heat_map(
        table.quality, np.rad2deg(rotations).tolist(), positions.tolist(),
        f"quality of the best grasp, {samples} simulations a square",
        ("standard deviation of rotation, deg",
         f"standard deviation of position{f', {unit}' if unit else ''}"),
    )  # fmt: skip


def candidates_3d_svg(
    plan: PushPlan, height: float, count: int = 12, holes: Sequence[FloatArray] = ()
) -> str:
    """Return the extruded part with its best grasps as jaws in space, seen from above one side."""
    ring = plan.part.vertices
    tilt, turn = np.deg2rad(35.0), np.deg2rad(-30.0)
    c, s = np.cos(turn), np.sin(turn)

    def seen(points: FloatArray, z: float) -> FloatArray:
        p = points - plan.part.centroid
        x, y = c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1]
        return np.column_stack([x, y * np.sin(tilt) + z * np.cos(tilt)])

    reach = 1.3 * plan.part.diameter
    canvas = Canvas((-reach, -0.8 * reach), (reach, 0.8 * reach + height), title="best grasps")
    order = plan.analysis.order[:count][::-1]
    best = max(plan.quality, 1e-12)
    for z in (0.0, height):
        canvas.polygon(seen(ring, z), "#222", "#ddd" if z else "#f4f4f4", 1.5, 0.9)
        for hole in holes:
            canvas.polygon(seen(hole, z), "#222", "white", 1.0, 0.9)
    for vertex in ring:
        canvas.line(np.vstack([seen(vertex[None], 0.0), seen(vertex[None], height)]), "#888", 1)
    for i in order.tolist():
        share = float(plan.analysis.quality[i]) / best
        along = plan.grasps.approaches[i]
        first = plan.grasps.jaw(i, plan.test.jaw_width)
        colour = f"rgb({round(220 * (1 - share))},{round(60 + 100 * share)},60)"
        for jaw in (first, first + along * plan.openings[i]):
            low, high = seen(jaw, 0.3 * height), seen(jaw, 1.4 * height)
            canvas.polygon(np.vstack([low, high[::-1]]), colour, colour, 1.0, 0.45)
    return canvas.svg()
