"""A Panda's arm with a suction cup, three fingers or jaws: seen, planned, lifted, put into the box.

    python tests/benchmarks/grasp/bench_arm_hands.py --hand suction:0.012
    python tests/benchmarks/grasp/bench_arm_hands.py --hand three:0.1 --objects 20 --seed 7

Generated objects as heavy as wood, at most 500 g, one at a time on the table, each seen by the
robot's noisy camera. The arm carries out the first grasp of the plan on that cloud that it can
reach, of the best eight. Wilson intervals.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from grasp.spatial.collision import Support
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_cloud
from grasp.spatial.gripper import panda_hand
from grasp.spatial.gripper_files import end_effector_named
from grasp.spatial.scoring.holding import assumed_mass
from grasp.spatial.suction import plan_suction_on_cloud
from grasp.spatial.suction_cup import SuctionCup
from grasp.spatial.three_finger.planning import plan_three_finger_on_cloud
from simulate.grasping.clutter import look_at_clutter
from simulate.grasping.executor import Workcell
from simulate.grasping.floating.execution import settle, spawn_parts
from simulate.grasping.rules import GraspRequest
from simulate.robots import describe
from simulate.study.intervals import wilson
from simulate.study.quality.objects import generated
from simulate.world.eyes import Eyes
from simulate.world.noise import SensorNoise

PLACE, HEAVIEST_KG, TRIED, LIFTED_M = (0.47, -0.12), 0.5, 8, 0.03


def attempt(text: str, seed: int, number: int, folder: Path) -> tuple[str, bool, bool]:
    """Return why the attempt ended, and whether the object was in the air and came into the box."""
    thing = generated(seed, number, panda_hand())
    mass = min(assumed_mass(thing.mesh()), HEAVIEST_KG)
    options = {} if text == "panda" else {"hand": text}
    with Workcell(describe("panda", **options), preset="fast") as cell:
        world = cell.world
        cell.executor.eyes = Eyes(cell.robot, noise=SensorNoise(), noise_seed=(seed, number))
        low = float(np.vstack(thing.parts)[:, 2].min())
        whole = thing.write_whole(folder)
        body = spawn_parts(
            world, thing.write(folder), mass, seen=(whole, (0.6, 0.6, 0.6, 1.0))
        )  # fmt: skip
        world.put(body, (*PLACE, world.table_height - low + 0.002), (0, 0, 0, 1))
        rest = settle(world, body)
        view = look_at_clutter(cell.executor)
        if view is None or not (view.labels > 0).any():
            return "not seen", False, False
        points = view.points[view.labels > 0]
        support, eye = Support(view.table_height), view.viewpoint[None]
        asked = SpatialOptions(mass=mass, seed=number)
        hand = end_effector_named(text)
        if text == "panda":
            found = plan_on_cloud(points, panda_hand(), support, eye, asked)
        elif isinstance(hand, SuctionCup):
            found = plan_suction_on_cloud(points, hand, support, eye, asked)
        else:
            found = plan_three_finger_on_cloud(points, hand, support, eye, asked)
        for one in found.candidates[:TRIED]:
            opening = one.width if one.opening is None else one.opening
            request = GraspRequest.at_pose(
                one.frame_from_gripper, one.width, opening, points, view.table_height, mass
            )
            plan = cell.executor.plan(request, seed=number)
            if isinstance(plan, str):
                continue
            run = cell.executor.begin(plan)
            reason = run.grasp()
            lifted = world.object_pose(body).z - rest.z > LIFTED_M
            if reason == "ok":
                run.place_in_box()
            box = world.place_boxes["right"]
            at = world.object_pose(body)
            low_y, high_y = box.y_range
            return reason, lifted, low_y < at.y < high_y and box.x_range[0] < at.x < box.x_range[1]
        return found.reason or "out of reach", False, False


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    ask.add_argument("--hand", default="suction:0.012", help="suction:RADIUS, three:OPENING, panda")
    ask.add_argument("--objects", type=int, default=20)
    ask.add_argument("--seed", type=int, default=7)
    told = ask.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        ends = []
        for number in range(told.objects):
            # Bullet keeps meshes by the names of their files.
            own = Path(folder) / str(number)
            own.mkdir()
            ends.append(attempt(told.hand, told.seed, number, own))
    for k, name in ((1, "lifted"), (2, "in the box")):
        count = sum(end[k] for end in ends)
        low, high = wilson(count, len(ends))
        print(f"{told.hand}: {name} {count} of {len(ends)} ({100 * low:.0f} to {100 * high:.0f} %)")
    print(dict(Counter(end[0] for end in ends)), "load", f"{os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
