"""Grasps in space: how fast they are judged, and what physics says of them.

    python tests/benchmarks/grasp/bench_grasp3d.py              # speed, both sides
    python tests/benchmarks/grasp/bench_grasp3d.py held         # the best candidate, true pose
    python tests/benchmarks/grasp/bench_grasp3d.py ranking      # s_G against nominal, noisy pose
    python tests/benchmarks/grasp/bench_grasp3d.py correlation  # s_G against simulated success

Speed: confidences under 100 perturbed poses, processor time of one thread, against the same
computation vectorised in NumPy around Open3D's ray caster (Embree), interleaved. The others execute
grasps with a floating Panda gripper in the physics engine, on products of our own families and,
with ``--ycb FOLDER``, on models of the YCB set (convex parts as collision shapes, masses from their
URDF files). Friction .5 in planning and physics.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.gripper import ParallelGripper, panda_hand
from grasp.spatial.mesh_candidates import propose_on_mesh
from grasp.spatial.meshes.mesh import Mesh, as_mesh
from grasp.spatial.meshes.mesh_files import read_mesh
from grasp.spatial.meshes.shapes import box_mesh, cup_mesh, lathed_mesh, sphere_mesh
from grasp.spatial.pairs import antipodal_pairs
from grasp.spatial.scoring.confidence import Load, PoseNoise, confidences, score_grasps
from grasp.spatial.scoring.select import rank
from simulate.grasping.floating.execution import execute, settle, spawn_parts
from simulate.world.objects import KINDS, Friction, product, write_assets
from simulate.world.world import BodyPose, World

HAND = panda_hand()
NOISE = PoseNoise()
PLACE = (0.34, 0.0)
TABLE = Support(0.0)
MIN_CONFIDENCE = 0.3


@dataclass(frozen=True, eq=False)
class Lying:
    """An object at rest on the table, ready to be grasped."""

    name: str
    mesh: Mesh
    world: World
    body: int
    rest: BodyPose
    mass: float
    hand: ParallelGripper = HAND

    @property
    def world_from_object(self) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rest.rotation, self.rest.position
        return pose

    def scored(self, seed: int = 0, screen: bool = True) -> list[GraspCandidate]:
        """Return candidates with scores, ranked; all that were drawn without ``screen``."""
        normal = tuple(self.rest.rotation.T @ [0.0, 0.0, 1.0])
        around = Surroundings(Support(-self.rest.z, normal))
        found = propose_on_mesh(self.mesh, self.hand, around, seed=seed, screen=screen)
        scored = score_grasps(
            list(found), self.mesh, self.hand, NOISE, seed=seed, exact=100, sweep=around.sweep,
            load=Load(self.mass, normal),
        )  # fmt: skip
        plain = score_grasps(list(found), self.mesh, self.hand, NOISE, seed=seed, exact=0)
        return rank(
            [
                replace(c, scores={**c.scores, "line": p.scores["confidence"]})
                for c, p in zip(scored, plain, strict=True)
            ]
        )

    def hold(self, candidate: GraspCandidate, error: np.ndarray | None = None) -> bool:
        """Execute a grasp with the gripper off by ``error`` (4, 4) and say whether it held."""
        pose = self.world_from_object @ candidate.frame_from_gripper
        pose = pose if error is None else pose @ error
        opening = candidate.opening or self.hand.max_opening
        # The error is the object's; where the table is, is known.
        low = TABLE.below(pose[None], self.hand.boxes(opening)[None])[0]
        pose[2, 3] += max(TABLE.clearance - low, 0.0)
        return execute(
            self.world, self.body, self.hand, pose, opening, self.rest, friction=1.0
        ).held


def objects(args: argparse.Namespace) -> Iterator[Lying]:
    """Yield products of the families and YCB models, each alone on the table."""
    friction = Friction(lateral=HAND.friction, rolling=0.0004)
    for kind in KINDS:
        for number in range(args.first, args.first + args.products * args.every, args.every):
            spec = product(kind, number)
            with tempfile.TemporaryDirectory() as folder, World() as world:
                mesh = read_mesh(write_assets(spec, Path(folder)).obj_path)
                world.add_table(0.0)
                body = world.spawn(spec, PLACE)
                world.client.changeDynamics(body, -1, lateralFriction=HAND.friction)
                yield Lying(spec.name, mesh, world, body, settle(world, body), spec.mass)
    models = sorted(Path(args.ycb).glob("*/textured.obj")) if args.ycb else []
    for path in models[args.first :: args.every]:
        parts = sorted(path.parent.glob("*coacd*.stl"))
        mesh = read_mesh(path) if args.scan else together([read_mesh(part) for part in parts])
        text = path.parent.with_suffix(".urdf").read_text("utf-8")
        mass = float(re.search(r'mass value="([\d.e+-]+)"', text).group(1))  # type: ignore[union-attr]
        centred = np.eye(4)
        centred[:3, 3] = -mesh.com
        mesh = mesh.moved(centred)
        with World() as world:
            world.add_table(0.0)
            body = spawn_parts(world, parts, mass, centred[:3, 3], friction)
            start = (*PLACE, 0.002 - mesh.vertices[:, 2].min())
            world.client.resetBasePositionAndOrientation(body, start, (0, 0, 0, 1))
            yield Lying(path.parent.name, mesh, world, body, settle(world, body), mass)


def together(parts: list[Mesh]) -> Mesh:
    """Return one mesh of convex parts: the shape that physics knows."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices = np.vstack([part.vertices for part in parts])
    return as_mesh(vertices, np.vstack([p.faces + s for p, s in zip(parts, starts, strict=False)]))


def wilson(k: int, n: int) -> str:
    """Return a share with its 95 % interval."""
    if n == 0:
        return "none tried"
    p, z = k / n, 1.96
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return f"{k}/{n} = {p:.1%} ({middle - half:.1%} to {middle + half:.1%})"


def held(args: argparse.Namespace) -> None:
    """Print how often the best candidate holds at the true pose."""
    good, tried, none = 0, 0, []
    sure, sure_good = 0, 0
    for thing in objects(args):
        candidates = thing.scored()
        if not candidates:
            none.append(thing.name)
            continue
        ok = thing.hold(candidates[0])
        good, tried = good + ok, tried + 1
        if candidates[0].scores["confidence"] >= MIN_CONFIDENCE:
            sure, sure_good = sure + 1, sure_good + ok
        if not ok:
            best = candidates[0]
            print(f"  lost: {thing.name}, s_G {best.scores['confidence']:.2f}, epsilon "
                  f"{best.scores['epsilon']:.2f}, width {best.width * 1e3:.0f} mm")  # fmt: skip
    print(f"held at the true pose, best candidate: {wilson(good, tried)}")
    print(f"of those with s_G of at least {MIN_CONFIDENCE}: {wilson(sure_good, sure)}")
    print(f"no candidate: {len(none)} ({', '.join(none)})")


def antipodality(candidate: GraspCandidate) -> float:
    """Return the cosine of the worse angle between closing axis and normals."""
    assert candidate.normals is not None
    return float(min(-candidate.normals[0] @ candidate.closing,
                     candidate.normals[1] @ candidate.closing))  # fmt: skip


RULES = {
    "s_G": lambda c: c.scores["confidence"],
    "line alone": lambda c: c.scores["line"],
    "nominal": antipodality,
    "epsilon": lambda c: c.scores["epsilon"],
}
"""What candidates may be ranked by. s_G: closing line, gripper's boxes, weight; all perturbed."""


def ranking(args: argparse.Namespace) -> None:
    """Print success under pose noise of the first by s_G and of the first by other rules."""
    rows = []
    for thing in objects(args):
        candidates = thing.scored()
        if not candidates:
            continue
        errors = NOISE.transforms(args.trials, seed=12345 + args.seed)
        drawn = thing.scored(screen=False)
        pool = {name: drawn if name == "nominal" and drawn else candidates for name in RULES}
        chosen = [candidates[0], *(max(pool[name], key=RULES[name]) for name in list(RULES)[1:])]
        rows.append([np.mean([thing.hold(c, e) for e in errors]) for c in chosen])
        said = "  ".join(f"{name} {v:.2f}" for name, v in zip(RULES, rows[-1], strict=True))
        print(f"  {thing.name:24s} {said}", flush=True)
        if len(rows) % 10 == 0:
            contrast(np.array(rows), args.trials)
    contrast(np.array(rows), args.trials)


def contrast(table: np.ndarray, trials: int) -> None:
    """Print means and paired differences with bootstrap intervals over objects."""
    rng = np.random.default_rng(0)
    print(f"{len(table)} objects, {trials} noisy poses each, the same for all rules")
    for column, name in enumerate(RULES):
        gain = table[:, 0] - table[:, column]
        low, high = np.percentile(rng.choice(gain, (4000, len(gain))).mean(axis=1), [2.5, 97.5])
        print(f"  first by {name:10s}: held {table[:, column].mean():.1%}; s_G better by "
              f"{gain.mean():+.1%} (95 % {low:+.1%} to {high:+.1%})", flush=True)  # fmt: skip


def correlation(args: argparse.Namespace) -> None:
    """Print rank correlations with simulated success under the same noise."""
    claims: dict[str, list[float]] = {name: [] for name in RULES}
    success: list[float] = []
    group: list[int] = []
    for number, thing in enumerate(objects(args)):
        candidates = thing.scored(screen=False)
        if len(candidates) < args.candidates:
            continue
        spread = np.linspace(0, len(candidates) - 1, args.candidates).astype(int)
        errors = NOISE.transforms(args.trials, seed=999 + args.seed)
        for candidate in (candidates[i] for i in spread):
            success.append(float(np.mean([thing.hold(candidate, e) for e in errors])))
            group.append(number)
            for name, rule in RULES.items():
                claims[name].append(rule(candidate))
        if (len(set(group)) % 10) == 0:
            associations(claims, success, group)
    associations(claims, success, group)


def associations(claims: dict[str, list[float]], success: list[float], group: list[int]) -> None:
    """Print rank correlations over all grasps and within each object."""
    print(f"{len(success)} grasps of {len(set(group))} objects, held {np.mean(success):.1%}")
    held_share, groups = np.array(success), np.array(group)
    for name, values in claims.items():
        v = np.array(values)
        inside = [
            spearmanr(v[groups == k], held_share[groups == k]).statistic
            for k in sorted(set(group))
            if np.ptp(v[groups == k]) > 0 and np.ptp(held_share[groups == k]) > 0
        ]
        print(f"  {name:10s}: over all {spearmanr(v, held_share).statistic:+.2f}, within an object "
              f"{np.mean(inside):+.2f} (mean of {len(inside)})", flush=True)  # fmt: skip


def embree(mesh: Mesh, poses: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return which grasps close (c, K) by two rays each of Open3D's ray caster."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor(mesh.faces.astype(np.uint32)),
    )
    moved = poses[:, None] @ errors[None]
    o, d = moved[..., :3, 3].reshape(-1, 3), moved[..., :3, 0].reshape(-1, 3)
    half, cone = HAND.max_opening / 2, np.cos(np.arctan(HAND.friction))
    rays = np.vstack([np.hstack([o - half * d, d]), np.hstack([o + half * d, -d])])
    hit = scene.cast_rays(o3d.core.Tensor(rays.astype(np.float32)), nthreads=1)
    t = hit["t_hit"].numpy().reshape(2, -1)
    face = np.minimum(hit["primitive_ids"].numpy(), len(mesh.faces) - 1).reshape(2, -1)
    along = [np.einsum("ni,ni->n", mesh.normals[f], d) for f in face]
    meets = (t <= 2 * half).all(axis=0) & (t.sum(axis=0) < 2 * half - 1e-4)
    return (meets & (-along[0] >= cone) & (along[1] >= cone)).reshape(len(poses), -1)


def speed(args: argparse.Namespace) -> None:
    """Print evaluations per second and core, ours and the peer's."""
    meshes = {
        "box": box_mesh((0.04, 0.06, 0.1)),
        "can, 79 mm wide": lathed_mesh([(0.0395, -0.05), (0.0395, 0.05)]),
        "cup, 60 mm wide": cup_mesh(0.03, 0.1, 0.004, 72),
        "sphere": sphere_mesh(0.03, 33),
        "sphere, fine": sphere_mesh(0.03, 46),
    }
    if args.ycb:
        meshes["YCB banana"] = read_mesh(Path(args.ycb) / "banana" / "textured.obj")
    errors = NOISE.transforms(100, 0)
    print("mesh               faces  sampled ms  planned ms  ours /s  embree /s  ratio  same")
    for name, mesh in meshes.items():
        pairs = antipodal_pairs(mesh, HAND, margin=0.0)
        poses = pairs.poses(pairs.across)[:1000]
        confidences(mesh, poses[:2], HAND)
        ours, peer, sample, plan = [], [], [], []
        for _ in range(args.repeats):
            start = time.process_time()
            mine = confidences(mesh, poses, HAND).closed
            ours.append(time.process_time() - start)
            start = time.process_time()
            other = embree(mesh, poses, errors)
            peer.append(time.process_time() - start)
            start = time.process_time()
            antipodal_pairs(mesh, HAND)
            sample.append(time.process_time() - start)
            start = time.process_time()
            found = propose_on_mesh(mesh, HAND, per_pair=1)
            held_by = np.stack([c.frame_from_gripper for c in found]) if found else poses[:60]
            confidences(mesh, held_by, HAND)
            plan.append(time.process_time() - start)
        a, b = len(poses) / np.median(ours), len(poses) / np.median(peer)
        print(f"{name:17s} {len(mesh.faces):6d} {np.median(sample) * 1e3:11.1f} "
              f"{np.median(plan) * 1e3:11.1f} {a:8.0f} {b:10.0f} {a / b:6.1f} "
              f"{(mine == other).mean():.4%}")  # fmt: skip


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    runs = {"speed": speed, "held": held, "ranking": ranking, "correlation": correlation}
    parser.add_argument("what", nargs="?", choices=list(runs), default="speed")
    parser.add_argument("--ycb", help="folder of YCB models, each with textured.obj and parts")
    parser.add_argument("--scan", action="store_true", help="plan on YCB scans, not on the parts")
    parser.add_argument("--products", type=int, default=10, help="of each of our five families")
    parser.add_argument("--trials", type=int, default=10, help="noisy poses for each grasp")
    parser.add_argument("--every", type=int, default=1, help="take each so manieth object")
    parser.add_argument("--first", type=int, default=0, help="of the objects that are taken")
    parser.add_argument("--seed", type=int, default=0, help="of the noise")
    parser.add_argument("--candidates", type=int, default=6, help="grasps of each object")
    parser.add_argument("--repeats", type=int, default=5, help="of each timing")
    args = parser.parse_args()
    runs[args.what](args)


if __name__ == "__main__":
    main()
