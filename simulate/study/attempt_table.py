"""A table of attempts: each grasp of each product tried several times by a hand without an arm.

Fleets are replayed from it (:mod:`simulate.fleet.replay`): many more than whole arms could play.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from grasp.spatial.footprint import Footprint
from grasp.spatial.frames import pose_from_planar
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.gripper_files import gripper_named
from grasp.spatial.planar import PlanarGrasp, propose_planar
from rtask.errors import UsageError
from simulate.grasping.floating.execution import execute
from simulate.study.declaration import Report, Results, Study
from simulate.world.objects import PRODUCTS, ObjectSpec, sample_products
from simulate.world.seeds import stream
from simulate.world.world import World

__all__ = [
    "Defect", "attempt_study", "attempt_trial", "attempts_named", "attempts_of", "read_attempts",
    "try_product",
]  # fmt: skip

_DRAW, _NOISE = 60, 61
_NOISE_M, _NOISE_Z_M, _NOISE_RAD = 0.002, 0.001, float(np.deg2rad(3.0))
_MAX_TURN_RAD = float(np.deg2rad(40.0))
_SETTLE_S = 0.2
_FORMAT = 1


@dataclass(frozen=True)
class Defect:
    """What is wrong with a hand, of which it knows nothing.

    Parameters
    ----------
    lets_go
        Share of its lifts in which it drops what it holds.
    beside_m
        How far beside the place that it aims at it closes, across its closing direction.
    """

    lets_go: float = 0.0
    beside_m: float = 0.0


def attempt_study(
    count: int, products: str, hand: str, grasps: int, tries: int, seed: int
) -> Study:
    """Return the study that tries the grasps of a number of products.

    Raises
    ------
    UsageError
        There is no such hand or set of products, or a number is out of range.
    """
    if products not in PRODUCTS:
        raise UsageError(f"--products: expected one of {', '.join(PRODUCTS)}, got {products!r}")
    if tries < 3 or grasps < 2:
        raise UsageError(f"needs at least 2 grasps and 3 tries, got {grasps} and {tries}")
    try:
        gripper_named(hand)
    except ValueError as error:
        raise UsageError(f"--gripper: {error}") from error
    return Study(
        "attempts by a hand without an arm",
        "simulate.study.attempt_table:attempt_trial",
        {
            "seed": seed, "products": products, "hand": hand, "grasps": grasps, "tries": tries,
            "count": count,
        },
        count, _describe,
    )  # fmt: skip


def attempt_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Try the grasps of one product; return each with its outcomes, as JSON data."""
    seed = int(settings["seed"])
    specs = sample_products(str(settings["products"]), stream(seed, _DRAW), int(settings["count"]))
    return try_product(specs[number], settings, number)


def try_product(
    spec: ObjectSpec, settings: Mapping[str, Any], number: int, defect: Defect | None = None
) -> dict[str, Any]:
    """Try the grasps of a product; return each with its outcomes, as JSON data.

    Parameters
    ----------
    settings
        ``seed``, ``hand``, ``grasps`` and ``tries``.
    number
        Of the trial, from which its noise is drawn.
    defect
        Of the hand; None for a hand that works.
    """
    defect = defect or Defect()
    hand, shape = gripper_named(str(settings["hand"])), _footprint(spec)
    rng = stream(int(settings["seed"]), _NOISE, number)
    arms: list[dict[str, Any]] = []
    with World("fast") as world:
        world.add_table()
        for grasp in _distinct(propose_planar(shape, hand, seed=number), int(settings["grasps"])):
            held = [
                _try(world, spec, hand, grasp, rng, defect.beside_m)
                and bool(rng.random() >= defect.lets_go)
                for _ in range(int(settings["tries"]))
            ]
            arms.append(
                {
                    "x": round(grasp.x, 6), "y": round(grasp.y, 6), "z": round(grasp.z, 6),
                    "theta": round(grasp.theta, 6), "quality": round(float(grasp.quality), 6),
                    "held": held,
                }
            )  # fmt: skip
    sure = sum(all(arm["held"]) for arm in arms)
    return {
        "product": spec.name,
        "kind": spec.kind,
        "size": [shape.length, shape.width, shape.height],
        "arms": arms,
        "says": f"{spec.name}: {sure} of {len(arms)} grasps always hold",
    }


def _footprint(spec: ObjectSpec) -> Footprint:
    """Return the true footprint at the origin, the longer side along x."""
    x, y, height = spec.extent
    yaw = 0.0 if x >= y else np.pi / 2
    is_round = float(spec.shape in ("can", "ball", "bottle"))
    return Footprint((0.0, 0.0), yaw, max(x, y), min(x, y), height, is_round)


def _distinct(grasps: Sequence[PlanarGrasp], most: int) -> list[PlanarGrasp]:
    """Return the best grasp of each place and direction, best first."""
    best_of_aim: dict[tuple[float, ...], PlanarGrasp] = {}
    for grasp in grasps:
        aim = round(grasp.x, 4), round(grasp.y, 4), round(grasp.theta, 4)
        best_of_aim.setdefault(aim, grasp)
    return list(best_of_aim.values())[:most]


def _try(
    world: World, spec: ObjectSpec, hand: ParallelGripper, grasp: PlanarGrasp,
    rng: np.random.Generator, beside_m: float = 0.0,
) -> bool:  # fmt: skip
    """Tell whether a grasp holds a new copy of a product, with the noise of perception."""
    x0 = world.workplace.table_near + world.workplace.table_size[0] / 2
    if spec.secret.travel_m and rng.random() < 0.5:  # a loose weight may lie at either end
        spec = replace(spec, secret=spec.secret.mirrored())
    body = world.spawn(spec, (x0, 0.0))
    world.step(_SETTLE_S)
    try:
        x, y = np.array([grasp.x, grasp.y]) + rng.normal(0, _NOISE_M, 2) + [x0, 0.0]
        z = world.table_height + grasp.z + rng.normal(0, _NOISE_Z_M)
        theta = grasp.theta + rng.normal(0, _NOISE_RAD)
        x, y = x - beside_m * np.sin(theta), y + beside_m * np.cos(theta)
        pose = np.asarray(pose_from_planar(float(x), float(y), float(z), float(theta)))
        rest = world.object_pose(body)
        done = execute(world, body, hand, pose, grasp.opening, rest)
        whole = body not in world.broken and not world.on_table(body)
        return bool(done.held and done.turned_rad < _MAX_TURN_RAD and whole)
    finally:
        world.remove(body)


def _describe(results: Results, settings: Mapping[str, Any], folder: Path) -> Report:
    products = [{k: v for k, v in result.items() if k != "says"} for result in results]
    made = sum(len(arm["held"]) for product in results for arm in product["arms"])
    held = sum(sum(arm["held"]) for product in results for arm in product["arms"])
    return Report(
        {"products": len(results), "attempts": made, "held": held},
        lines=[f"{made} attempts at {len(results)} products, {held} held"],
        more={"format": _FORMAT, "settings": dict(settings), "products": products},
        file="attempts.json",
    )


def attempts_named(path: Path) -> dict[str, str]:
    """Return settings by which trials find a table, and by which another one is noticed.

    Raises
    ------
    UsageError
        As :func:`read_attempts`.
    """
    read_attempts(path)
    return {
        "attempts": str(path.resolve()),
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }


def attempts_of(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of :func:`attempts_named`.

    Raises
    ------
    UsageError
        It has changed since then.
    """
    return _read_once(settings["attempts"], settings["sha256"])


@lru_cache(maxsize=1)
def _read_once(path: str, sha256: str) -> dict[str, Any]:
    if hashlib.sha256(Path(path).read_bytes()).hexdigest() != sha256:
        raise UsageError(f"{path} has changed since the study began; name another output folder")
    return read_attempts(Path(path))


def read_attempts(path: Path) -> dict[str, Any]:
    """Read a table of attempts.

    Raises
    ------
    UsageError
        The file is missing, no JSON, or no such table.
    """
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if data["format"] != _FORMAT or not data["products"]:
            raise ValueError(f"format {data['format']!r}, {len(data['products'])} products")
        for product in data["products"]:
            for arm in product["arms"]:
                if len(arm["held"]) < 3:
                    raise ValueError(f"{product['product']}: a grasp with fewer than 3 tries")
        gripper_named(str(data["settings"]["hand"]))
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(
            f"{path} holds no table of attempts ({error}); "
            "make one with: rtask study attempts --out FOLDER"
        ) from error
    return data
