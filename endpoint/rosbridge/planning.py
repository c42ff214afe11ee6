"""The server's own action: plans grasps for what a robot sees, with feedback and cancellation."""

from __future__ import annotations

import time
from typing import Any

from endpoint.rosbridge.actions import Action, Progress
from endpoint.rosbridge.messages import JsonObject
from endpoint.rosbridge.services import Engine
from rtask.errors import UsageError
from rtask.kb.commit.access import Access

_OWN = ("samples",)


def plan_grasps_action(engine: Engine) -> list[Action]:
    """Return the action `/rtask/plan_grasps`, if the engine can recognise objects."""
    if "recognise_for_grasp" not in engine.operations:
        return []

    def plan(args: JsonObject, access: Access, progress: Progress) -> JsonObject:
        started = time.monotonic()
        _check_samples(args.get("samples"))
        request = {name: value for name, value in args.items() if name not in _OWN}
        progress.report(0.05, "sampling", candidates=0, best_quality=0.0)
        answer = engine.call("recognise_for_grasp", {**request, "propose": True}, access)
        grasps: list[JsonObject] = answer["grasps"]
        best = max((float(grasp.get("grasp_quality") or 0.0) for grasp in grasps), default=0.0)
        progress.report(1.0, "ranking", candidates=len(grasps), best_quality=best)
        return {
            "task_id": answer["task_id"],
            "object": answer["object"],
            "class": answer["class"],
            "grasps": grasps,
            "candidates": len(grasps),
            "seconds": round(time.monotonic() - started, 6),
        }

    return [Action("/rtask/plan_grasps", "rtask/PlanGrasps", "read", plan)]


def _check_samples(samples: Any) -> None:
    """Refuse a number of samples that is none."""
    if samples is not None and (type(samples) is not int or samples < 1):
        raise UsageError("samples: expected a whole number above 0", field="samples")
