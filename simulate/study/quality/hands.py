"""First grasps of a cup, of three fingers or of jaws: planned on one noisy view, and on the mesh.

Generated objects as heavy as wood, at most 500 g, at rest, each seen by one camera. A hand without
an arm takes the first grasp of either plan four times, with the same errors of the pose (4 mm, .1
rad) and frictions for both, lifts and shakes. An object without a planned grasp counts as not held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.candidate import Proposals
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud, plan_on_mesh
from grasp.spatial.gripper import panda_hand
from grasp.spatial.scoring.holding import assumed_mass
from grasp.spatial.suction import plan_suction, plan_suction_on_cloud
from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.hand import ThreeFingerHand
from grasp.spatial.three_finger.planning import plan_three_finger, plan_three_finger_on_cloud
from simulate.grasping.floating.cup import execute_suction
from simulate.grasping.floating.execution import Held, execute
from simulate.grasping.floating.three_finger import execute_three_finger
from simulate.robots.description import Floats
from simulate.study.grasp_views import depth_view, sample_camera
from simulate.study.intervals import bootstrap
from simulate.study.quality.bench import Bench, draws, laid_out
from simulate.study.quality.objects import generated
from simulate.world.noise import SensorNoise

__all__ = ["KINDS", "StudiedHand", "hand_trial", "held_shares", "summarise_hands"]

_TRIALS, _OFF_TABLE_M, _HEAVIEST_KG = 4, 0.006, 0.5
_OUTCOMES = ("lifted", "carried")


@dataclass(frozen=True)
class StudiedHand:
    """A kind of hand: its plans on a mesh and on a cloud, and its execution in physics.

    Parameters
    ----------
    on_mesh, on_cloud
        As :func:`plan_suction` and :func:`plan_suction_on_cloud`, without the hand.
    execute
        Takes world, body, pose, opening, rest and conditions.
    """

    on_mesh: Callable[..., Proposals]
    on_cloud: Callable[..., Proposals]
    execute: Callable[..., Held]


def cup(radius_m: float) -> StudiedHand:
    """Return a suction cup."""
    lip = SuctionCup("cup", radius=radius_m)
    return StudiedHand(
        lambda mesh, *more: plan_suction(mesh, lip, *more),
        lambda points, *more: plan_suction_on_cloud(points, lip, *more),
        lambda world, body, pose, _, *more: execute_suction(world, body, lip, pose, *more),
    )


def three_fingers(opening_m: float) -> StudiedHand:
    """Return a hand with three fingers of 20 N."""
    hand = ThreeFingerHand("centric", opening_m)
    return StudiedHand(
        lambda mesh, *more: plan_three_finger(mesh, hand, *more),
        lambda points, *more: plan_three_finger_on_cloud(points, hand, *more),
        lambda world, body, *more: execute_three_finger(world, body, hand, *more),
    )


def jaws() -> StudiedHand:
    """Return the Panda's gripper."""
    hand = panda_hand()
    return StudiedHand(
        lambda mesh, *more: plan_on_mesh(mesh, hand, *more),
        lambda points, *more: plan_on_cloud(points, hand, *more),
        lambda world, body, pose, opening, rest, conditions: execute(
            world, body, hand, pose, opening or hand.max_opening, rest, conditions=conditions
        ),
    )


KINDS: Mapping[str, Callable[[Mapping[str, Any]], StudiedHand]] = {
    "cup": lambda settings: cup(settings["radius"]),
    "three": lambda settings: three_fingers(settings["opening"]),
    "jaws": lambda settings: jaws(),
}
"""Hands by name, made of the settings of the study: sizes in m."""


def hand_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Return the shares of an object, of :func:`held_shares`; None where nothing was planned."""
    hand = KINDS[settings["hand"]](settings)
    shares = held_shares(hand, settings["seed"], number).tolist()
    return {"shares": [[None if v != v else v for v in plan] for plan in shares]}


def held_shares(hand: StudiedHand, seed: int, number: int) -> Floats:
    """Return how often the first grasps for a generated object lift and carry it.

    Parameters
    ----------
    number
        Of the object.

    Returns
    -------
    (2, 2), shares of the trials: planned on the mesh, on one view; lifted, carried. NaN where
    nothing was planned.
    """
    generated_object = generated(seed, number, panda_hand())
    mass = min(assumed_mass(generated_object.mesh()), _HEAVIEST_KG)
    options = SpatialOptions(mass=mass, seed=number)
    with laid_out(replace(generated_object, mass=mass)) as bench:
        mesh = bench.mesh.moved(bench.world_from_object)
        place = np.array([*bench.rest.position[:2], 0.0])
        eye = place + sample_camera(np.random.default_rng((seed, number)))
        view = depth_view(mesh, eye, SensorNoise(), number)
        points = view.points[view.points[:, 2] > _OFF_TABLE_M]
        plans = (
            hand.on_mesh(mesh, Surroundings(Support(0.0)), options),
            hand.on_cloud(points, Support(0.0), eye[None], options)
            if len(points) > 3
            else Proposals(reason="nothing over the table"),
        )
        return np.array([_shares_of_first(bench, plan, hand, seed, number) for plan in plans])


def _shares_of_first(
    bench: Bench, plan: Proposals, hand: StudiedHand, seed: int, number: int
) -> Floats:
    """Return the shares (2,) of trials in which the first grasp lifts and carries."""
    if not plan:
        return np.full(2, np.nan)
    size = float(np.linalg.norm(bench.mesh.extent))
    outcomes = []
    for draw in draws(seed, number, _TRIALS, size):
        pose = plan[0].frame_from_gripper @ draw.error
        done = hand.execute(
            bench.world, bench.body, pose, plan[0].opening, bench.rest, draw.conditions
        )
        outcomes.append((done.held, bool(done.carried)))
    shares: Floats = np.mean(np.array(outcomes, dtype=float), axis=0)
    return shares


def _mean_of(values: Floats, rows: NDArray[np.intp]) -> float:
    return float(values[rows].mean())


def summarise_hands(shares: Floats) -> dict[str, Any]:
    """Return means over objects, and the difference of the view with a 95 % interval over objects.

    Parameters
    ----------
    shares : (n, 2, 2)
        Of `held_shares`, for each object.
    """
    without = np.isnan(shares[:, :, 0]).sum(axis=0)
    # Left out, such objects would favour the plan that gives up sooner.
    table = np.nan_to_num(shares)
    summary: dict[str, Any] = {
        "objects": len(table),
        "without_a_grasp": {"mesh": int(without[0]), "view": int(without[1])},
    }
    for k, name in enumerate(_OUTCOMES):
        difference = table[:, 1, k] - table[:, 0, k]
        low, high = bootstrap(partial(_mean_of, difference), len(table))
        summary[name] = {
            "mesh": float(table[:, 0, k].mean()),
            "view": float(table[:, 1, k].mean()),
            "difference": float(difference.mean()),
            "interval95": [low, high],
        }
    return summary
