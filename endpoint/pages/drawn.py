"""Drawings of objects on pages: grippers as lines in 3D, and belief in success as a curve."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from endpoint.pages.render import Model, embedded_graph
from rtask.engine.stored import stored_models
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode
from rtask.world.scene.nodes import grasp_lines
from rtask.world.surfaces import stored_mesh

__all__ = ["belief_over", "clouds_of", "curve", "gripper_lines", "has_viewer"]

_DEFAULT_OPENING_M = 0.05
_VIEWER = Path(__file__).parent / "static" / "vendor" / "clouds.js"
_CURVE_PX = (340, 130)
_LEFT_PX, _TOP_PX, _BOTTOM_PX = 42, 8, 20
"""Room for the words at the axes of a curve."""


def has_viewer() -> bool:
    """Tell whether the library that draws clouds in 3D was bundled at set-up."""
    return _VIEWER.exists()


def clouds_of(model: NamedNode, views: list[Model]) -> list[dict[str, str]]:
    """Return the name and the IRI of each cloud of an object, its surface and its model first.

    The surface, which is no cloud, has ``surface`` in the place of an IRI; a stale one comes last.

    Parameters
    ----------
    views
        Its views, as the page shows them.
    """
    kb = embedded_graph()
    models = stored_models(kb, model)
    clouds = [{"name": "model of all views", "cloud": ""}] if models else []
    for number, view in enumerate(views, 1):
        if view["cloud"] and kb.match(NamedNode(str(view["view"])), RT.viewpoint):
            clouds.append({"name": f"view {number}", "cloud": str(view["view"])})
    surface = stored_mesh(kb, model)
    if surface is not None:
        seen = f"{surface.seen_share:.0%} seen"
        if surface.is_current:
            clouds.insert(0, {"name": f"surface, {seen}", "cloud": "surface"})
        else:
            clouds.append({"name": f"surface of former views, {seen}", "cloud": "surface"})
    return clouds


def gripper_lines(grasp: Model) -> list[list[float]]:
    """Return the lines (x, y, z, x, y, z), m, object frame, that draw a gripper at a grasp.

    Parameters
    ----------
    grasp
        With x, y, z, and theta or a quaternion; without them there is nothing to draw.

    Examples
    --------
    >>> lines = gripper_lines({"x": 0.0, "y": 0.0, "z": 0.1, "theta": 0.0, "opening": 0.06})
    >>> [round(value, 3) for value in lines[0]]
    [0.03, 0.0, 0.14, 0.03, 0.0, 0.1]
    """
    import numpy as np

    from grasp.spatial.frames import matrix_from_pose, pose_from_planar

    at = [grasp.get(axis) for axis in "xyz"]
    turned = [grasp.get(name) for name in ("qx", "qy", "qz", "qw")]
    if None in at or (grasp.get("theta") is None and None in turned):
        return []
    if grasp.get("theta") is not None:
        x, y, z = (float(grasp[axis]) for axis in "xyz")
        object_from_gripper = pose_from_planar(x, y, z, float(grasp["theta"]))
    else:
        object_from_gripper = matrix_from_pose(
            np.array(at, np.float64), np.array(turned, np.float64)
        )
    opening = float(grasp.get("opening") or grasp.get("contact_width") or _DEFAULT_OPENING_M)
    moved = grasp_lines(opening) @ object_from_gripper[:3, :3].T + object_from_gripper[:3, 3]
    return [[round(float(value), 5) for value in line.ravel()] for line in moved]


def belief_over(judged: Sequence[bool]) -> list[dict[str, float]]:
    """Return the belief that an attempt succeeds after each attempt, with its 90 % interval.

    Parameters
    ----------
    judged
        Whether each attempt held, the oldest first; the belief begins even, Beta(1, 1). Nothing is
        returned where scipy is not installed.

    Examples
    --------
    >>> [round(one["mean"], 2) for one in belief_over([True, True, False])]
    [0.67, 0.75, 0.6]
    """
    try:
        from scipy.special import betaincinv
    except ModuleNotFoundError:  # comes with an extra; the page shows the counts without it
        return []

    interval, won = [], 0
    for number, held in enumerate(judged, 1):
        won += bool(held)
        alpha, beta = 1 + won, 1 + number - won
        low, high = (float(betaincinv(alpha, beta, share)) for share in (0.05, 0.95))
        interval.append({"mean": alpha / (alpha + beta), "low": low, "high": high})
    return interval


def curve(belief: Sequence[dict[str, float]]) -> dict[str, Any]:
    """Return the size, the axes and the points of SVG lines that show a belief.

    Examples
    --------
    >>> curve(belief_over([True]))["mean"]
    '191.0,42.0'
    """
    width, height = _CURVE_PX
    step = (width - _LEFT_PX) / (len(belief) + 1)
    tall = height - _TOP_PX - _BOTTOM_PX

    def level(share: float) -> float:
        return _TOP_PX + tall * (1 - share)

    def points(name: str) -> list[str]:
        return [
            f"{_LEFT_PX + step * number:.1f},{level(value[name]):.1f}"
            for number, value in enumerate(belief, 1)
        ]

    mean = points("mean")
    return {
        "width": width,
        "height": height,
        "left": _LEFT_PX,
        "levels": [(level(share), share) for share in (0.0, 0.5, 1.0)],
        "mean": " ".join(mean),
        "band": " ".join([*points("high"), *reversed(points("low"))]),
        "dots": [point.split(",") for point in mean],
    }
