"""One push grasp of Object M, or of a printed part like it, by the simulated arm."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.push.push_plan import PushPlan
from simulate.grasping.executor import Workcell
from simulate.grasping.push_grasping import ArmPush, PushRun, plan_arm_push
from simulate.robots.description import Floats
from simulate.study.pushes.plug import (
    ARM,
    JAW_M,
    TRUE_COM,
    PlaneBody,
    arm_push,
    chosen,
    image_of,
    lay,
    plan_from_image,
    plug,
    printed,
)
from simulate.world.seeds import mix_seed, stream

__all__ = ["carry_out", "lies_flat", "planned", "push_trial"]

_ERROR, _CHOICE = 80, 81
_PLACE_STD_M, _TURN_STD_RAD = 0.002, float(np.deg2rad(2.0))
_LIFTED_M = 0.05
_NEAR_M, _LAID_M = 0.0003, 0.004
_NOTHING: dict[str, Any] = {"held": False, "flat": False, "turned_deg": None}


@lru_cache(maxsize=2)
def planned(seed: int, preset: str) -> tuple[PushPlan, NDArray[np.uint8], float, float]:
    """Return the plan on the plug's image, the image, and width and stroke of the jaws, m."""
    with Workcell("panda", preset) as cell:
        hand = cell.robot.arm(ARM)
        lay(cell, plug())
        pixels = image_of(cell)
        stroke = float(hand.mouth)
        return plan_from_image(pixels, JAW_M, stroke, seed), pixels, JAW_M, stroke


def push_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Carry out one grasp once; return what happened as JSON data.

    The first ``trials`` numbers of a grasp take the plug itself, with errors of the hand's place
    (2 mm, 2 degrees) and the plug's true centre of mass: ``com``, where the settings have it, see
    :func:`simulate.study.pushes.plug.plug`. The others take a part printed from the
    distribution that was planned for, and an exact hand.
    """
    seed, preset = int(settings["seed"]), str(settings["preset"])
    each = int(settings["trials"]) + int(settings["prints"])
    which, k = divmod(number, each)
    plan, _, jaw, stroke = planned(seed, preset)
    index = chosen(plan, jaw, stroke)[which]
    off, turned, part = np.zeros(2), 0.0, plug(float(settings.get("com", TRUE_COM)))
    made = k >= int(settings["trials"])
    if made:
        copy = printed(plan, jaw, k - int(settings["trials"]), seed)
        if copy is None:
            return {"grasp": which, "printed": True, "reason": "crossed", **_NOTHING,
                    "says": "the outline crosses itself"}  # fmt: skip
        part = copy
    else:
        rng = stream(seed, _ERROR, which, k)
        off, turned = rng.normal(0.0, _PLACE_STD_M, 2), float(rng.normal(0.0, _TURN_STD_RAD))
    push = arm_push(plan, index, jaw, stroke, off=off, turned=turned)
    with Workcell("panda", preset) as cell:
        result = carry_out(cell, part, push, mix_seed(seed, _CHOICE, which, k))
    return {"grasp": which, "printed": made, **result,
            "says": f"{result['reason']}, {'held' if result['held'] else 'not held'}"}  # fmt: skip


def carry_out(cell: Workcell, part: PlaneBody, push: ArmPush, seed: int) -> dict[str, Any]:
    """Lay a part down, push, close and lift; return the robot's reason code and what is true.

    ``held`` means that both fingers hold the part at the top of the lift; ``flat`` that the part
    lay flat on the first jaw when the hand had closed, as planned; ``turned_deg`` is how far it had
    turned by then.
    """
    body = lay(cell, part)
    world = cell.world
    planned_push = plan_arm_push(cell.executor, ARM, push, seed)
    if isinstance(planned_push, str):
        return {"reason": planned_push, **_NOTHING}
    before = world.object_pose(body)
    run = PushRun(cell.executor, *planned_push)
    if run.push() != "ok" or run.close() != "ok":
        return {"reason": run.reason, **_NOTHING}
    closed = world.object_pose(body)
    ring = (part.ring - part.com) @ closed.rotation[:2, :2].T + closed.position[:2]
    middle = cell.robot.tool_pose(ARM)[:2, 3]
    flat = lies_flat(ring, push.direction, middle, JAW_M)
    reason = run.lift()
    risen = world.object_pose(body).z - before.z > _LIFTED_M
    held = bool(risen and cell.robot.touch(ARM, body).links >= 2)
    turned = float(np.degrees(closed.yaw - before.yaw))
    return {"reason": reason, "held": held, "flat": flat, "turned_deg": round(turned, 1)}


def lies_flat(ring: Floats, push: Floats, middle: Floats, jaw: float) -> bool:
    """Tell whether an outline (n, 2), m, lies on a jaw that pushes along the unit vector ``push``.

    It does where what is within .3 mm of the jaw's face spans at least 4 mm: an edge, or two
    vertices of a push with two contacts (Kehoe 2014, 3.3).

    Parameters
    ----------
    middle : (2,), m
        Any point of the line along which the middle of the jaw moves.
    jaw
        Width of its face, m.

    Examples
    --------
    >>> square = np.array([(0.0, 0.0), (0.02, 0.0), (0.02, 0.02), (0.0, 0.02)])
    >>> [lies_flat(square, np.array([np.sin(a), np.cos(a)]), square[1] / 2, 0.02) for a in (0, 0.2)]
    [True, False]
    """
    share = np.linspace(0, 1, 200)[:, None, None]
    boundary = (ring + share * (np.roll(ring, -1, axis=0) - ring)).reshape(-1, 2) - middle
    depth, beside = boundary @ push, boundary @ np.array([push[1], -push[0]])
    over = np.abs(beside) <= jaw / 2
    if not over.any():
        return False
    near = beside[over & (depth < depth[over].min() + _NEAR_M)]
    return bool(np.ptp(near) >= _LAID_M)
