"""Benchmark of simulated grasping at true poses, with noise on request, without a camera.

    python tests/benchmarks/grasp/bench_grasping.py single -n 100
    python tests/benchmarks/grasp/bench_grasping.py single -n 100 --robot panda
    python tests/benchmarks/grasp/bench_grasping.py single -n 60 --far 0.10
    python tests/benchmarks/grasp/bench_grasping.py single -n 100 --plan-only --preset fast
    python tests/benchmarks/grasp/bench_grasping.py table -n 8 --objects 7 --sigma 0.003

``single`` puts one object on the table at a time, alternating between the arms and the kinds;
``table`` lays several and clears them, the others being obstacles. An object counts as held when
one of at most three grasps held it. With ``--plan-only`` the first attempt at each is planned, and
not carried out. Prints a table with Wilson 95 % intervals.
"""

from __future__ import annotations

import argparse
import itertools
import json
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from grasp.spatial.footprint import Footprint
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.planar import propose_planar
from simulate.agent.scoring import AttemptTruth
from simulate.grasping.executor import Executor, GraspRecord, GraspRequest, Workcell
from simulate.motion.collision import Obstacle
from simulate.robots import Arm, Workplace
from simulate.world.objects import KINDS, ObjectSpec, collision_of, product
from simulate.world.world import World

MAX_GRASPS, MAX_PLANS = 3, 12
AREA_BEYOND = 0.01


@dataclass
class Tally:
    """Attempts at one object."""

    kind: str
    side: str
    arm: str = ""
    as_it_stands: bool = False
    plan_only: bool = False
    stance: str = ""
    attempts: int = 0
    planned: bool = False
    held: bool = False
    placed: bool = False
    reasons: list[str] = field(default_factory=list)
    place_reason: str = ""
    planning: list[float] = field(default_factory=list)
    plan_s: float = 0.0
    execute_s: float = 0.0
    log: list[dict[str, object]] = field(default_factory=list)


def surface(spec: ObjectSpec) -> np.ndarray:
    """Return points (n, 3) of an object's convex parts in its body frame."""
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    parts = []
    for shape in collision_of(spec):
        if shape.shape == "box":
            local = np.array(np.meshgrid(*[[-s / 2, s / 2] for s in shape.size])).reshape(3, -1).T
        elif shape.shape == "cylinder":
            r, half = shape.size[0], shape.size[1] / 2
            rings = [np.stack([r * np.cos(angle), r * np.sin(angle), 0 * angle + z], 1)
                     for z in (-half, half)]  # fmt: skip
            local = np.concatenate(rings)
        else:
            ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
            local = shape.size[0] * np.concatenate([ring, [[0, 0, 1.0], [0, 0, -1.0]]])
        x, y, z, w = shape.orientation
        v = np.array([x, y, z])
        turned = local + 2 * np.cross(v, np.cross(v, local) + w * local)
        parts.append(turned + shape.position)
    return np.concatenate(parts)


def measured(world: World, body: int, rng: np.random.Generator, sigma: float) -> Footprint | None:
    """Return what perfect perception with position noise would say of an object."""
    spec, pose = world.objects[body], world.object_pose(body)
    points = surface(spec) @ pose.rotation.T + pose.position
    if abs(pose.z - world.table_height) > 0.15:
        return None
    prism = Obstacle.around("object", points, world.table_height)
    sizes = 2 * prism.half[:2]
    yaw = float(np.arctan2(prism.rotation[1, 0], prism.rotation[0, 0]))
    if sizes[1] > sizes[0]:
        sizes, yaw = sizes[::-1], yaw + np.pi / 2
    stands = abs(pose.rotation[2, 2]) > 0.95
    round_ = spec.kind == "ball" or (spec.kind in ("can", "bottle") and stands)
    x, y = prism.centre[:2] + rng.normal(0, sigma, 2)
    if round_:
        sizes = np.array([max(sizes), max(sizes)])
    return Footprint(
        (float(x), float(y)), yaw, float(sizes[0]), float(sizes[1]), float(2 * prism.half[2]),
        roundness=1.0 if round_ else 0.0,
    )  # fmt: skip


def hand_of(arm: Arm) -> ParallelGripper:
    """Return what proposes grasps for an arm's hand."""
    return ParallelGripper(arm.gripper_type, arm.gripper_type, 0.0, arm.mouth)


def attempt(
    executor: Executor,
    body: int,
    others: list[Obstacle],
    tally: Tally,
    tried: list[tuple[float, float, float]],
    rng: np.random.Generator,
    sigma: float,
) -> GraspRecord | None:
    """Plan the best grasp not tried yet and carry it out."""
    world = executor.world
    seen = measured(world, body, rng, sigma)
    if seen is None:
        return None
    started = time.process_time()
    best, aim = None, (0.0, 0.0, 0.0)
    # Of candidates alike but for height and opening the first is enough: the planner tries others.
    hand = hand_of(executor.robot.arm(tally.side))
    grasps, kept = propose_planar(seen, hand, seed=int(rng.integers(1 << 30))), []
    for grasp in grasps:
        offset = (grasp.x - seen.centre[0], grasp.y - seen.centre[1], grasp.theta)
        if all(np.linalg.norm(np.subtract(offset, k[1])) > 1e-6 for k in kept):
            kept.append((grasp, offset))
    stances = ("own",) if tally.as_it_stands else ("own", "other")
    for stance, (grasp, offset) in itertools.product(stances, kept[:MAX_PLANS]):
        if any(np.abs(np.subtract(offset, t)).max() < 0.01 for t in tried):
            continue
        request = GraspRequest(
            grasp.x, grasp.y, grasp.theta, world.table_height + grasp.z, grasp.width, seen.height,
            seen.length, grasp.opening, world.table_height, "auto", seen.kind == "round",
            stances=stance,
        )  # fmt: skip
        before = time.process_time()
        plan = executor.plan(request, others, seed=int(rng.integers(1 << 30)))
        tally.planning.append(time.process_time() - before)
        if isinstance(plan, str):
            tally.reasons.append(plan)
            continue
        if best is None or not plan.is_doubtful:
            best, aim = plan, offset
        if not plan.is_doubtful:
            break
    tally.plan_s += time.process_time() - started
    if best is None:
        return None
    tried.append(aim)
    tally.planned, tally.arm, tally.stance = True, best.arm, best.stance or "upright"
    if tally.plan_only:
        return None
    started = time.process_time()
    watch = AttemptTruth(executor.world, executor.robot, best)
    record = executor.execute(best, watch)
    truth = watch.truth
    tally.execute_s += time.process_time() - started
    tally.attempts += 1
    tally.reasons.append(record.reason)
    tally.held, tally.placed = truth.held, truth.placed
    tally.place_reason = record.place_reason
    tally.log.append(
        {
            "reason": record.reason, "place": record.place_reason, "tilt": round(record.tilt, 2),
            "pushed": round(truth.pushed_m, 4), "links": dict(record.links),
            "force": round(record.contact_force_n, 1), "lifted": round(truth.lifted_m, 3),
            "slip": round(record.slip_m, 4), "height": best.tool_height, "opening": best.opening,
            "offset": round(record.place_offset_m, 3),
            "duration": round(record.duration_s, 1),
        }
    )  # fmt: skip
    return record


def clear(
    executor: Executor, bodies: list[int], args: argparse.Namespace, seed: int
) -> list[Tally]:
    """Grasp every object, at most three times each; objects given up stay as obstacles."""
    world, found = executor.world, []
    for body in bodies:
        pose = world.object_pose(body)
        tally = Tally(world.objects[body].kind, "right" if pose.y < 0 else "left")
        tally.as_it_stands, tally.plan_only = args.as_it_stands, args.plan_only
        found.append(tally)
        tried: list[tuple[float, float, float]] = []
        for number in range(MAX_GRASPS):
            rng = np.random.default_rng((seed, body, number))
            others = []
            for other in bodies:
                if other == body or other not in world.objects:
                    continue
                points = surface(world.objects[other]) @ world.object_pose(other).rotation.T
                points = points + world.object_pose(other).position
                inside = any(
                    b.y_range[0] < points[:, 1].mean() < b.y_range[1]
                    for b in world.place_boxes.values()
                )
                if not inside and abs(points[:, 2].min() - world.table_height) < 0.1:
                    shift = np.array([*rng.normal(0, args.sigma, 2), 0.0])
                    others.append(Obstacle.around("neighbour", points + shift, world.table_height))
            record = attempt(executor, body, others, tally, tried, rng, args.sigma)
            if record is None or record.held:
                break
        if args.single:
            world.remove(body)
    return found


def make_world(args: argparse.Namespace) -> tuple[World, Executor]:
    """Return a robot's world and its executor."""
    cell = Workcell(args.robot, args.preset)
    return cell.world, cell.executor


def run_single(args: argparse.Namespace) -> list[Tally]:
    world, executor = make_world(args)
    tallies = []
    kinds = args.kinds or KINDS
    for trial in range(args.start, args.start + args.n):
        rng = np.random.default_rng((args.seed, trial))
        spec = product(kinds[trial % len(kinds)], int(rng.integers(200))).scaled(args.scale)
        side = -1 if (trial // len(kinds)) % 2 == 0 else 1
        x, y, yaw = place(spec, side, rng, world.workplace, args.far)
        body = world.spawn(spec, (x, y), yaw)
        world.step(0.3)
        tally = clear(executor, [body], args, args.seed * 1000 + trial)[0]
        tallies.append(tally)
        if args.verbose:
            print(trial, spec.name, spec.dims, f"{x:.3f} {y:.3f} {yaw:.2f}", tally, flush=True)
    return tallies


def run_table(args: argparse.Namespace) -> list[Tally]:
    tallies = []
    for trial in range(args.start, args.start + args.n):
        rng = np.random.default_rng((args.seed, trial))
        world, executor = make_world(args)
        places: list[tuple[float, float]] = []
        for _number in range(200):
            if len(places) == args.objects:
                break
            side = -1 if len(places) % 2 == 0 else 1
            kinds = args.kinds or KINDS
            spec = product(kinds[len(places) % len(kinds)], int(rng.integers(200)))
            x, y, yaw = place(spec, side, rng, world.workplace)
            reach = [0.06 + 0.3 * max(0.0, max(spec.extent[:2]) - 0.05)] * len(places)
            if all(np.hypot(x - a, y - b) >= r for (a, b), r in zip(places, reach, strict=True)):
                places.append((x, y))
                world.spawn(spec, (x, y), yaw)
        world.step(0.3)
        bodies = sorted(world.objects, key=lambda b: -abs(world.object_pose(b).y))
        found = clear(executor, bodies, args, args.seed * 1000 + trial)
        if args.verbose:
            for tally in found:
                print(trial, tally, flush=True)
        tallies += found
        world.close()
    return tallies


def place(
    spec: ObjectSpec, side: int, rng: np.random.Generator, on: Workplace, far: float = 0.0
) -> tuple[float, float, float]:
    """Draw x, y, yaw with the whole outline on the table, on one side and clear of the boxes."""
    half = np.array(spec.extent[:2]) / 2
    (x0, x1), (y0, y1) = on.area_x, on.area_abs_y
    outside = on.box_centre[1] - on.box_inner / 2 - 0.008
    while True:
        x = rng.uniform(x0 - AREA_BEYOND, x1 + AREA_BEYOND + far)
        y = side * rng.uniform(y0 - AREA_BEYOND, y1 + AREA_BEYOND)
        yaw = rng.uniform(0, 2 * np.pi)
        cos, sin = abs(np.cos(yaw)), abs(np.sin(yaw))
        reach = half if spec.is_round and spec.kind != "pen" else half @ [[cos, sin], [sin, cos]]
        near = on.table_near + 0.002
        if x - reach[0] > near and abs(y) - reach[1] > 0 and abs(y) + reach[1] < outside:
            return float(x), float(y), float(yaw)


def wilson(k: int, n: int) -> str:
    if n == 0:
        return "-"
    z, p = 1.96, k / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return f"{k}/{n} {100 * p:.0f}% [{100 * (middle - half):.0f}, {100 * (middle + half):.0f}]"


def report(tallies: list[Tally]) -> None:
    groups = {kind: [t for t in tallies if t.kind == kind] for kind in KINDS}
    groups["all but pens"] = [t for t in tallies if t.kind != "pen"]
    for side in ("right", "left"):
        groups[f"{side} side"] = [t for t in tallies if t.side == side]
    for arm in sorted({t.arm for t in tallies if t.arm}):
        groups[arm] = [t for t in tallies if t.arm == arm]
    for stance in sorted({t.stance for t in tallies if t.stance}):
        groups[stance] = [t for t in tallies if t.stance == stance]
    groups["all"] = tallies
    print(f"{'group':14}{'planned':>22}{'held':>22}{'held at first':>22}{'placed of held':>22}")
    for name, group in groups.items():
        held = [t for t in group if t.held]
        first = [t for t in held if t.attempts == 1]
        print(
            f"{name:14}{wilson(sum(t.planned for t in group), len(group)):>22}"
            f"{wilson(len(held), len(group)):>22}{wilson(len(first), len(group)):>22}"
            f"{wilson(sum(t.placed for t in held), len(held)):>22}"
        )
    tried, lost = Counter(), Counter()
    for tally in tallies:
        tried.update(r for r in tally.reasons if r != "ok")
        if not tally.held:
            lost.update([tally.reasons[-1] if tally.reasons else "no_grasp"])
    print("reasons of what failed on the way ", dict(tried.most_common()))
    print("reasons of objects never held     ", dict(lost.most_common()))
    print("places", dict(Counter(t.place_reason or "-" for t in tallies)))
    plans = np.array([s for t in tallies for s in t.planning])
    attempts = max(sum(t.attempts for t in tallies), 1)
    print(
        f"CPU s of one plan: median {np.median(plans):.3f}, 95 % {np.quantile(plans, 0.95):.3f} "
        f"(n = {len(plans)}); of one execution {sum(t.execute_s for t in tallies) / attempts:.2f}"
    )
    whole = np.array([t.plan_s for t in tallies])
    print(
        f"CPU s of planning for an object, all grasps tried: median {np.median(whole):.3f}, 95 % "
        f"{np.quantile(whole, 0.95):.3f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mode", nargs="?", default="single", choices=("single", "table"))
    parser.add_argument("-n", type=int, default=20)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--objects", type=int, default=7)
    parser.add_argument("--kinds", nargs="*")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sigma", type=float, default=0.0, help="noise of the pose, m")
    parser.add_argument("--robot", default="nao")
    parser.add_argument("--scale", type=float, default=1.0, help="of the objects (single)")
    parser.add_argument("--far", type=float, default=0.0, help="m that the area goes on (single)")
    parser.add_argument("--as-it-stands", action="store_true", help="never lean")
    parser.add_argument("--plan-only", action="store_true", help="do not carry grasps out")
    parser.add_argument("--preset", default="faithful")
    parser.add_argument("--json", type=Path)
    parser.add_argument("-v", "--verbose", action="store_true")
    args = parser.parse_args()
    args.single = args.mode == "single"
    tallies = run_single(args) if args.single else run_table(args)
    report(tallies)
    if args.json:
        args.json.write_text(json.dumps([vars(t) for t in tallies], default=str), encoding="utf-8")


if __name__ == "__main__":
    main()
