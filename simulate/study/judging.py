"""Trials of the robot's own judgement, which is afterwards compared with the ground truth.

A trial is one attempt at one object or, with products whose best grasp cannot be seen, one box that
is filled with them, each held anywhere along its length. In difficult attempts, friction, mass and
grasp errors vary widely, so that many of them fail.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from rtask.scratch import ScratchFolder
from simulate.agent.scoring import watch_attempts
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.grasping.executor import GraspRequest, PlannedGrasp
from simulate.robots import describe
from simulate.study.declaration import Report, Results, Study, Table
from simulate.study.intervals import share
from simulate.world.camera import Lighting
from simulate.world.hidden import HiddenKind
from simulate.world.objects import KINDS, Kind, ObjectSpec, product
from simulate.world.scene import Placement, arrange, lay
from simulate.world.seeds import mix_seed, stream

__all__ = [
    "COLUMNS",
    "filling_trial",
    "grasp_across",
    "judging_rows",
    "judging_study",
    "judging_trial",
    "summarise_judging",
]

COLUMNS = ("robot", "question", "attempts", "true", "right", "false yes", "false no", "unknown")
_PRODUCT, _PLACE, _LIGHT, _NOISE, _ERROR, _DIFFICULT, _FILL = range(50, 57)
_PRODUCTS_OF_A_KIND = 200
_DRAWS = 5
_FRICTION, _MASS_FACTOR = (0.03, 0.8), (1.0, 8.0)
_POSITION_ERROR, _ANGLE_ERROR_RAD = 0.2, 0.17
"""Standard deviations; the position error as a share of the width of the open hand."""
_HIDDEN: Mapping[str, tuple[HiddenKind, ...]] = {
    "hard": ("bar", "flask", "carton"),
    "light": ("carton", "rod"),
    "fragile": ("carton", "carton", "rod", "carton"),
}
"""Kinds that boxes are filled with, by the name of the set; each kind is drawn anew."""
_IN_A_BOX = 4
_OFF_MIDDLE = 0.36
"""Of a product's length, the farthest from its middle that it is held."""


def judging_study(
    trials: int,
    seed: int,
    robot: str = "nao",
    preset: str = "faithful",
    difficult: float = 0.5,
    products: str = "plain",
) -> Study:
    """Return the study of one robot's judgements; kinds alternate, and sides after each round.

    Parameters
    ----------
    difficult
        Share of attempts with random friction, mass and grasp error.
    products
        ``plain``: single objects; any other set: boxes filled with products with a secret, of
        which none is made more difficult.
    """
    name = "own judgement against the truth"
    settings: dict[str, Any] = {"seed": seed, "robot": robot, "preset": preset}
    if products != "plain":
        settings["products"] = products
        return Study(name, "simulate.study.judging:filling_trial", settings, trials, _describe)
    settings["difficult"] = difficult
    return Study(name, "simulate.study.judging:judging_trial", settings, trials, _describe)


def filling_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Fill one box with products with a secret; return the attempts, judged and scored.

    Each stands alone on the table, at a place and in a direction of its own, is held somewhere
    along its length, and is taken away if it is not in the box afterwards. One that turns out to
    be out of reach is put elsewhere, a few times.
    """
    seed, kinds = int(settings["seed"]), _HIDDEN[str(settings["products"])]
    rng, side = stream(seed, _FILL, number), 1 if number % 2 else -1
    specs = [
        product(kinds[int(k)], int(rng.integers(_PRODUCTS_OF_A_KIND)))
        for k in rng.integers(len(kinds), size=_IN_A_BOX)
    ]
    attempts = []
    with ScratchFolder("assets") as assets:
        body = SimulatedBody([], assets, _conditions(settings, number))
        try:
            for spec in specs:
                for _ in range(_DRAWS):
                    tried = _put_into_box(body, spec, side, rng, assets, number)
                    if tried["planned"]:
                        break
                attempts.append({"product": spec.name, **tried})
        finally:
            body.close()
    placed = sum(attempt["placed"] == "yes" for attempt in attempts if attempt["planned"])
    says = f"{placed} of {len(attempts)} placed"
    return {"robot": settings["robot"], "attempts": attempts, "says": says}


def _put_into_box(
    body: SimulatedBody,
    spec: ObjectSpec,
    side: int,
    rng: np.random.Generator,
    assets: Path,
    number: int,
) -> dict[str, Any]:
    """Lay one product at a random place and try it; take it away if it is not in the box then."""
    (placement,) = arrange([spec], rng, [side], workplace=body.robot.description.workplace)
    (laid,) = lay(body.world, [placement], assets)
    off = float(rng.uniform(-_OFF_MIDDLE, _OFF_MIDDLE)) * spec.extent[0]
    request = _held_off_middle(grasp_across(body, placement), placement, off)
    tried = _attempt(body, request, number)
    # What did not get into the box lies where the next product is to lie.
    if tried.get("truth", {}).get("placed") is not True:
        body.world.remove(laid.body)
    return tried


def _held_off_middle(request: GraspRequest, placement: Placement, off_m: float) -> GraspRequest:
    """Return the grasp shifted along the object, with its outline as it is seen from above."""
    along = np.array([np.cos(placement.yaw), np.sin(placement.yaw)])
    x, y = np.array([placement.x, placement.y]) + off_m * along
    length, width, _ = placement.spec.extent
    outline = (placement.x, placement.y, placement.yaw, length, width)
    return replace(request, x=float(x), y=float(y), outline=outline)


def judging_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Try one grasp of one object; return the robot's judgement and the truth.

    An object that turns out to be out of reach is put elsewhere, a few times.
    """
    seed, robot = int(settings["seed"]), str(settings["robot"])
    side = -1 if (number // len(KINDS)) % 2 == 0 else 1
    difficult = stream(seed, _DIFFICULT, number).random() < float(settings["difficult"])
    spec = _product(KINDS[number % len(KINDS)], seed, number, difficult)
    result: dict[str, Any] = {}
    for again in range(_DRAWS):
        # The first place comes from the stream without a number: the figures of a seed stay.
        place = stream(seed, _PLACE, number, *((again,) if again else ()))
        (placement,) = arrange([spec], place, [side], workplace=describe(robot).workplace)
        result = _judged(settings, placement, number, difficult)
        if result["planned"]:
            break
    return {"robot": robot, "product": spec.name, "says": f"{spec.name}: {result['says']}", **{
        name: value for name, value in result.items() if name != "says"
    }}  # fmt: skip


def _judged(
    settings: Mapping[str, Any], placement: Placement, number: int, difficult: bool
) -> dict[str, Any]:
    """Try one grasp of an object at a place."""
    seed = int(settings["seed"])
    with ScratchFolder("assets") as assets:
        body = SimulatedBody([placement], assets, _conditions(settings, number))
        try:
            error = stream(seed, _ERROR, number) if difficult else None
            return _attempt(body, grasp_across(body, placement, error), mix_seed(seed, number))
        finally:
            body.close()


def _conditions(settings: Mapping[str, Any], number: int) -> Conditions:
    seed = int(settings["seed"])
    return Conditions(
        robot=str(settings["robot"]),
        preset=str(settings["preset"]),
        lighting=Lighting.sample(stream(seed, _LIGHT, number)),
        noise_seed=(seed, _NOISE, number),
    )


def _product(kind: Kind, seed: int, number: int, difficult: bool) -> ObjectSpec:
    """Return a product, with random friction and mass if it is to be difficult."""
    rng = stream(seed, _PRODUCT, number)
    spec = product(kind, int(rng.integers(_PRODUCTS_OF_A_KIND)))
    if not difficult:
        return spec
    friction = float(np.exp(rng.uniform(*np.log(_FRICTION))))
    return replace(
        spec,
        mass=spec.mass * float(rng.uniform(*_MASS_FACTOR)),
        friction=replace(spec.friction, lateral=friction),
    )


def _attempt(body: SimulatedBody, request: GraspRequest, seed: int) -> dict[str, Any]:
    watched = watch_attempts(body)
    plan = body.executor.plan(request, seed=seed)
    if not isinstance(plan, PlannedGrasp):
        return {"planned": False, "reason": plan, "says": plan}
    frames = body.eyes.frames
    started = time.process_time()
    record, _ = body.execute(plan)
    truth = watched[-1].truth
    return {
        "planned": True,
        "reason": record.reason,
        "place_reason": record.place_reason,
        "held": record.judged_held.answer,
        "placed": record.judged_placed.answer,
        "old_place": record.old_place.answer,
        "evidence": record.evidence,
        "truth": asdict(truth),
        "frames": body.eyes.frames - frames,
        "cpu_s": round(time.process_time() - started, 3),
        "says": f"{record.evidence}; truly {truth.reason or record.reason}",
    }


def grasp_across(
    body: SimulatedBody, placement: Placement, error: np.random.Generator | None = None
) -> GraspRequest:
    """Return a grasp across the narrow side of the object, with random errors if requested."""
    spec = placement.spec
    along_x, along_y, height = spec.extent
    theta = placement.yaw + (np.pi / 2 if along_x > along_y else 0.0)
    dx = dy = turned = 0.0
    if error is not None:
        mouth = min(arm.mouth for arm in body.robot.arms.values())
        dx, dy = error.normal(0.0, _POSITION_ERROR * mouth, 2)
        turned = error.normal(0.0, _ANGLE_ERROR_RAD)
    return GraspRequest(
        x=placement.x + float(dx),
        y=placement.y + float(dy),
        theta=float((theta + turned) % np.pi),
        width=min(along_x, along_y),
        length=max(along_x, along_y),
        height=height,
        table_height=body.world.table_height,
        round=spec.kind in ("can", "ball", "bottle"),
    )


def summarise_judging(results: Results) -> dict[str, Any]:
    """Return the figures as JSON data: how often the judgements agree with the truth."""
    every = [attempt for result in results for attempt in result.get("attempts", [result])]
    tried = [attempt for attempt in every if attempt["planned"]]
    figures = {
        question: _agreement([(r[question], bool(r["truth"][question])) for r in tried])
        for question in ("held", "placed")
    }
    return {
        "trials": len(results),
        "attempts": len(tried),
        "not_held": share(sum(not r["truth"]["held"] for r in tried), len(tried)),
        **figures,
        "frames": float(np.mean([r["frames"] for r in tried])) if tried else None,
        "reasons": dict(Counter(attempt["reason"] for attempt in every)),
    }


def _agreement(pairs: Sequence[tuple[str, bool]]) -> dict[str, Any]:
    yes_count = sum(answer == "yes" for answer, _ in pairs)
    false_yes = sum(answer == "yes" and not true for answer, true in pairs)
    return {
        "true": sum(true for _, true in pairs),
        "right": share(sum((answer == "yes") == true for answer, true in pairs), len(pairs)),
        "false_yes": share(false_yes, yes_count),
        "false_no": sum(answer == "no" and true for answer, true in pairs),
        "unknown": sum(answer == "unknown" for answer, _ in pairs),
    }


def judging_rows(robot: str, summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of :data:`COLUMNS`."""
    return [
        (
            robot,
            question,
            str(summary["attempts"]),
            str(summary[question]["true"]),
            _percent(summary[question]["right"]),
            _percent(summary[question]["false_yes"]),
            str(summary[question]["false_no"]),
            str(summary[question]["unknown"]),
        )
        for question in ("held", "placed")
    ]


def _percent(part: Mapping[str, Any]) -> str:
    if not part["n"]:
        return "-"
    low, high = part["interval95"]
    return f"{part['hits']}/{part['n']} [{100 * low:.1f}, {100 * high:.1f}] %"


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    summary = {"seed": settings["seed"], **summarise_judging(results)}
    return Report(
        summary,
        [Table("Own judgement against ground truth", COLUMNS,
               judging_rows(settings["robot"], summary))],
        [f"attempts that held nothing: {summary['not_held']['hits']}"],
        {"results": list(results)},
    )  # fmt: skip
