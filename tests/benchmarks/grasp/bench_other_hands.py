"""First grasps of a cup, of three fingers or of jaws on one noisy view, beside those on the mesh.

    python tests/benchmarks/grasp/bench_other_hands.py
    python tests/benchmarks/grasp/bench_other_hands.py --hand three --objects 100 --seed 7
    python tests/benchmarks/grasp/bench_other_hands.py --hand jaws --objects 16 --seed 7

Generated objects as heavy as wood, at most 500 g, at rest, each seen by one camera. The floating
hand takes the first grasp of either plan four times in physics, with the same errors of the pose
(4 mm, .1 rad) and frictions for both, lifts and shakes. An object of which a plan finds nothing
counts as not held. The interval of the difference resamples objects.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

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
from simulate.study.grasp_views import depth_view, sample_camera
from simulate.study.intervals import bootstrap
from simulate.study.quality.bench import Bench, draws, laid_out
from simulate.study.quality.objects import generated
from simulate.world.noise import SensorNoise

TRIALS, OFF_TABLE_M, HEAVIEST_KG = 4, 0.006, 0.5


@dataclass(frozen=True)
class Hand:
    """A kind of hand: its plans on a mesh and on a cloud, and its carrying out.

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


def cup_of(radius: float) -> Hand:
    """Return a suction cup."""
    cup = SuctionCup("cup", radius=radius)
    return Hand(
        lambda mesh, *more: plan_suction(mesh, cup, *more),
        lambda points, *more: plan_suction_on_cloud(points, cup, *more),
        lambda world, body, pose, _, *more: execute_suction(world, body, cup, pose, *more),
    )


def fingers_of(opening: float) -> Hand:
    """Return a hand with three fingers of 20 N."""
    hand = ThreeFingerHand("centric", opening)
    return Hand(
        lambda mesh, *more: plan_three_finger(mesh, hand, *more),
        lambda points, *more: plan_three_finger_on_cloud(points, hand, *more),
        lambda world, body, *more: execute_three_finger(world, body, hand, *more),
    )


def jaws() -> Hand:
    """Return the Panda's gripper."""
    hand = panda_hand()
    return Hand(
        lambda mesh, *more: plan_on_mesh(mesh, hand, *more),
        lambda points, *more: plan_on_cloud(points, hand, *more),
        lambda world, body, pose, opening, rest, conditions: execute(
            world, body, hand, pose, opening or hand.max_opening, rest, conditions=conditions
        ),
    )


def held(bench: Bench, found: Proposals, hand: Hand, seed: int, number: int) -> np.ndarray:
    """Return the shares of trials (2,) in which the first grasp lifts and carries; world frame."""
    if not found:
        return np.zeros(2)
    size = float(np.linalg.norm(bench.mesh.extent))
    outcomes = []
    for draw in draws(seed, number, TRIALS, size):
        pose = found[0].frame_from_gripper @ draw.error
        done = hand.execute(
            bench.world, bench.body, pose, found[0].opening, bench.rest, draw.conditions
        )
        outcomes.append((done.held, bool(done.carried)))
    return np.mean(np.array(outcomes, dtype=float), axis=0)


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ask.add_argument("--objects", type=int, default=60)
    ask.add_argument("--seed", type=int, default=5150)
    ask.add_argument("--hand", choices=("cup", "three", "jaws"), default="cup")
    ask.add_argument("--radius", type=float, default=0.012, help="of the cup, m")
    ask.add_argument("--opening", type=float, default=0.1, help="of three fingers, m")
    told = ask.parse_args()
    kinds = {"cup": lambda: cup_of(told.radius), "three": lambda: fingers_of(told.opening)}
    hand = {**kinds, "jaws": jaws}[told.hand]()
    shares, none = [], [0, 0]
    for number in range(told.objects):
        thing = generated(told.seed, number, panda_hand())
        thing = replace(thing, mass=min(assumed_mass(thing.mesh()), HEAVIEST_KG))
        options = SpatialOptions(mass=thing.mass, seed=number)
        with laid_out(thing) as bench:
            mesh = bench.mesh.moved(bench.world_from_object)
            place = np.array([*bench.rest.position[:2], 0.0])
            eye = place + sample_camera(np.random.default_rng((told.seed, number)))
            view = depth_view(mesh, eye, SensorNoise(), number)
            points = view.points[view.points[:, 2] > OFF_TABLE_M]
            plans = (
                hand.on_mesh(mesh, Surroundings(Support(0.0)), options),
                hand.on_cloud(points, Support(0.0), eye[None], options)
                if len(points) > 3
                else Proposals(reason="nothing over the table"),
            )
            for k, plan in enumerate(plans):
                none[k] += not plan
            shares.append([held(bench, plan, hand, told.seed, number) for plan in plans])
    table = np.array(shares)
    for k, name in enumerate(("lifted", "carried")):
        whole, seen = table[:, 0, k], table[:, 1, k]
        low, high = bootstrap(lambda i, d=seen - whole: float(d[i].mean()), len(table))
        print(
            f"{name}: mesh {whole.mean():.3f}, one view {seen.mean():.3f}, difference "
            f"{(seen - whole).mean():+.3f} [{low:+.3f}, {high:+.3f}]"
        )
    print(f"without a grasp: mesh {none[0]}, one view {none[1]} of {len(table)}")
    print("load", *(f"{v:.1f}" for v in os.getloadavg()))


if __name__ == "__main__":
    main()
