"""Whether a robot knows where a thing came to lie that its hand lost near the box.

    python tests/benchmarks/grasp/bench_lost_things.py [--robot nao] [--boxes 10] [--seed 0]

Rods and cartons fall over a box and around it, six at each; what comes to rest inside stays, up to
three. After each, the robot looks into the box and at the table and judges. Prints how often it
says yes, no and unknown of what is in the box and of what is not, and the share of the box seen. Of
what is unknown though something new lies in the box, a robot concludes at the end of its work that
it is there, if it is nowhere on the table ("new").
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from simulate.agent.scoring import ObjectState, is_placed
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.grasping.attempt.looking import Looks
from simulate.grasping.judgement import judge_placed, share_left
from simulate.robots.description import Floats
from simulate.world.camera import Lighting
from simulate.world.objects import Kind, ObjectSpec, product
from simulate.world.scene import Placement, lay
from simulate.world.world import PlaceBox, World

_KINDS: tuple[Kind, ...] = ("rod", "carton")
_AT_A_BOX, _STAY = 6, 3
_FAR_M = -3.0
_STEP_S, _STEPS, _REST_S, _STILL_M_S = 0.05, 40, 0.2, 0.005


def drop_near(world: World, body: int, box: PlaceBox, rng: np.random.Generator) -> None:
    """Let a thing fall, two times of five from over the box, else from up to 6 cm beside it."""
    half = world.workplace.box_inner / 2
    reach = half - 0.02 if rng.random() < 0.4 else half + 0.06
    x, y = np.array(box.centre) + rng.uniform(-1, 1, 2) * reach
    angles = (rng.uniform(0, 2 * np.pi), rng.normal(0, 0.5), rng.normal(0, 0.3))
    turn = Rotation.from_euler("ZYX", angles).as_quat()
    client = world.client
    client.resetBasePositionAndOrientation(body, (x, y, 1.0), turn)
    low, _ = client.getAABB(body)
    height = 1.0 + box.rim + rng.uniform(0.0, 0.10) - low[2]
    client.resetBasePositionAndOrientation(body, (x, y, height), turn)
    client.resetBaseVelocity(body, rng.normal(0, 0.15, 3), rng.normal(0, 1.0, 3))
    for _ in range(_STEPS):
        world.step(_STEP_S)
        if np.linalg.norm(client.getBaseVelocity(body)[0]) < _STILL_M_S:
            break
    world.step(_REST_S)


def state_of(world: World, body: int, spec: ObjectSpec) -> ObjectState:
    """Return where a thing is in truth."""
    pose = world.object_pose(body)
    half = np.array(spec.extent) / 2
    return ObjectState(pose.position, bottom=float(pose.z - np.abs(pose.rotation[2]) @ half))


def judge_box(robot: str, seed: int, number: int) -> tuple[list[tuple[bool, str]], list[float]]:
    """Let things fall at one box; return truth and answer of each, and the share of it seen."""
    rng, shares = np.random.default_rng((seed, number)), list[float]()
    answers: list[tuple[bool, str]] = []
    with tempfile.TemporaryDirectory() as assets:
        conditions = Conditions(
            robot=robot, preset="fast", lighting=Lighting.sample(rng), noise_seed=(seed, number)
        )
        body = SimulatedBody([], Path(assets), conditions)
        try:
            world = body.world
            box = world.place_boxes["left" if number % 2 else "right"]
            plan = SimpleNamespace(request=SimpleNamespace(table_height=world.table_height))
            looks = Looks(body.executor, plan)  # type: ignore[arg-type]  # needs no grasp
            inside: list[int] = []
            for k in range(_AT_A_BOX):
                spec = product(_KINDS[int(rng.integers(len(_KINDS)))], int(rng.integers(200)))
                before, table = looks.box(box), looks.beside(box)
                (laid,) = lay(world, [Placement(spec, _FAR_M - k, 0.0, 0.0)], Path(assets))
                drop_near(world, laid.body, box, rng)
                volume = float(np.prod(spec.extent))
                after, table_after = looks.box(box), looks.beside(box)
                on_table = share_left(table, table_after, volume) - 1.0  # it was not there before
                is_inside = is_placed(state_of(world, laid.body, spec), box)
                judged = judge_placed(False, before, after, volume, on_table)
                is_open = judged.answer == "unknown" and judged.is_new_there
                answers.append((is_inside, "new" if is_open else judged.answer))
                shares.append(_seen(after.heights))
                if is_inside and len(inside) < _STAY:
                    inside.append(laid.body)
                else:
                    world.remove(laid.body)
        finally:
            body.close()
    return answers, shares


def _seen(heights: Floats) -> float:
    return float(np.isfinite(heights[1:-1, 1:-1]).mean())


def main() -> None:
    """Judge, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="nao")
    parser.add_argument("--boxes", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    counts, shares = Counter[tuple[bool, str]](), list[float]()
    for number in range(given.boxes):
        answers, seen = judge_box(given.robot, given.seed, number)
        counts.update(answers)
        shares += seen
        print(number, *(f"{'in' if inside else 'out'}:{answer}" for inside, answer in answers))
    for inside in (True, False):
        said = {answer: counts[inside, answer] for answer in ("yes", "no", "new", "unknown")}
        print("in the box " if inside else "elsewhere  ", said)
    print(f"of the box is seen {np.median(shares):.2f} (median)")


if __name__ == "__main__":
    main()
