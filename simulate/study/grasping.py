"""Trials of grasping with perception in the loop: one object, one robot, an empty graph.

The seed and the number of a trial determine everything: kind and product, side, place, light,
noise, and every choice. The robot sees only through its noisy camera; ground truth is used
afterwards, for scoring.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

import rtask
from features.perception import Seen
from rtask.scratch import ScratchFolder
from simulate.agent.agent import Agent, AgentConfig, Server
from simulate.agent.encounter import Encounter
from simulate.agent.scoring import Scorer
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.robots import describe
from simulate.world.camera import Lighting
from simulate.world.objects import KINDS, product
from simulate.world.scene import arrange
from simulate.world.seeds import stream

__all__ = ["grasping_trial"]

_PRODUCT, _PLACE, _LIGHT, _NOISE, _CHOICE = range(10, 15)
_PRODUCTS_OF_A_KIND = 200


def grasping_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Run a robot at a table with one object; return the outcome as JSON data."""
    seed = int(settings["seed"])
    kind = KINDS[number % len(KINDS)]
    side = -1 if (number // len(KINDS)) % 2 == 0 else 1
    spec = product(kind, int(stream(seed, _PRODUCT, number).integers(_PRODUCTS_OF_A_KIND)))
    robot = str(settings["robot"])
    workplace = describe(robot).workplace
    (placement,) = arrange([spec], stream(seed, _PLACE, number), [side], workplace)
    conditions = Conditions(
        robot=robot,
        preset=str(settings["preset"]),
        lighting=Lighting.sample(stream(seed, _LIGHT, number)),
        noise_seed=(seed, _NOISE, number),
    )
    with ScratchFolder("assets") as assets:
        body = SimulatedBody([placement], assets, conditions)
        try:
            encounters, attempts, errors, in_reach = _clear(body, settings, seed, number)
        finally:
            body.close()
    result = {
        "product": spec.name,
        "kind": kind,
        "arm": "right" if side < 0 else "left",
        "x": round(placement.x, 4),
        "y": round(placement.y, 4),
        "yaw": round(placement.yaw, 4),
        "in_reach": in_reach,
        "perceived": errors,
        **_summary(attempts, encounters),
    }
    outcome = "held" if result["held"] else result["reason"]
    return {**result, "says": f"{spec.name}: {outcome}"}


def _clear(
    body: SimulatedBody, settings: Mapping[str, Any], seed: int, number: int
) -> tuple[list[Encounter], list[dict[str, Any]], dict[str, float], bool]:
    """Return encounters, attempts, errors of perception, and whether the object was in reach."""
    scorer = Scorer(body)
    target = body.laid[0].body
    truth = body.world.object_pose(target)
    spec = body.laid[0].placement.spec
    errors: dict[str, float] = {}
    ours: set[int] = set()

    def on_sight(encounter: Encounter, seen: Seen) -> None:
        if scorer.body_under(seen) != target:
            return
        ours.add(encounter.number)
        if not errors:
            along, across = sorted(spec.extent[:2], reverse=True)
            centre = np.hypot(seen.position[0] - truth.x, seen.position[1] - truth.y)
            errors.update(
                centre_mm=round(1000 * float(centre), 2),
                length_mm=round(1000 * (seen.shape.length - along), 2),
                width_mm=round(1000 * (seen.shape.width - across), 2),
                height_mm=round(1000 * (seen.shape.height - spec.extent[2]), 2),
            )

    (in_reach,) = scorer.in_reach().values()
    choice = int(stream(seed, _CHOICE, number).integers(2**31))
    config = AgentConfig(max_attempts=int(settings["max_attempts"]), seed=choice)
    with rtask.open(":memory:", reason=False) as kb, rtask.connect(kb, agent="robot") as client:
        client.call("register_robot", **body.robot.describe("robot"))
        agent = Agent(body, cast(Server, client), config, on_sight=on_sight)
        encounters = [e for e in agent.clear_table() if e.number in ours]
    return encounters, _attempts(encounters, scorer), errors, in_reach


def _summary(attempts: list[dict[str, Any]], encounters: list[Encounter]) -> dict[str, Any]:
    """Return the true outcome for one object, which may have been lost and found again."""
    physical = [attempt for attempt in attempts if attempt["physical"]]
    held = [attempt["held"] for attempt in physical]
    reason = "ok"
    if not any(held):
        reason = str(attempts[-1]["reason"]) if attempts else "gone" if encounters else "not_seen"
    return {
        "attempts": attempts,
        "tries": len(physical),
        "held": any(held),
        "held_first": bool(held) and held[0],
        "placed": any(attempt["placed"] for attempt in physical),
        "placed_first": _first_place(physical),
        "tries_to_success": held.index(True) + 1 if any(held) else None,
        "reason": reason,
    }


def _attempts(encounters: list[Encounter], scorer: Scorer) -> list[dict[str, Any]]:
    """Return the attempts with their true outcomes."""
    rows = []
    for attempt in (a for encounter in encounters for a in encounter.attempts):
        truth = scorer.truth_of(attempt)
        rows.append(
            {
                "reason": attempt.reason,
                "held": truth is not None and truth.held,
                "placed": truth is not None and truth.placed,
                "judged_held": attempt.held,
                "judged_placed": attempt.placed,
                "place_reason": attempt.place_reason,
                "physical": attempt.physical,
            }
        )
    return rows


def _first_place(physical: list[dict[str, Any]]) -> bool | None:
    """Return whether the object was placed when first held; None if never held."""
    return next((bool(a["placed"]) for a in physical if a["held"]), None)
