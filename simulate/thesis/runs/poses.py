"""Poses and grasps in Kehoe 2014, chapter 4: Tables 4.2 and 4.3, the axis check of 4.6."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from features.geometry import Frame, Intrinsics, look_at, pose_matrix
from features.pose import (
    PoseEstimate,
    PoseModel,
    PoseParams,
    axis_check,
    build_pose_model,
    estimate_pose,
    pose_error,
)
from features.segmentation import segment_scene
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_mesh
from grasp.spatial.gripper import panda_hand
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.mesh_files import read_mesh
from rtask.scratch import ScratchFolder
from simulate.grasping.floating.execution import execute, settle
from simulate.thesis.materials.products import SIX, STAND_INS, household
from simulate.thesis.result import Compared, Result, Setting, share_of
from simulate.world.camera import Camera, Lighting
from simulate.world.noise import SensorNoise
from simulate.world.objects import write_assets
from simulate.world.world import BodyPose, World

__all__ = ["axis", "poses_by_rule", "table_4_2", "table_4_3"]

Matrix = NDArray[np.float64]

_POSES = 15
_PUBLISHED = {
    "air freshener": (2, 7.4, 2, 13, 76), "candy": (0, 1.4, 3, 15, 30),
    "juice": (1, 10.2, 1, 14, 105), "mustard": (2, 10.6, 3, 13, 61),
    "peanut butter": (2, 2.1, 2, 13, 80), "soap": (0, 3.6, 0, 15, 30),
}  # fmt: skip
"""Wrong poses of 15, seconds, lost grasps of how many, candidates (Tables 4.2 and 4.3)."""

_CAMERA = Intrinsics(640, 480, 579.4, 579.4, 319.5, 239.5)
_DISTANCE_M = 0.6
_NOISE_NOTE = "depth with the noise of a structured-light camera at .6 m; masks from the segmenter"
_LEAST = 0.3
"""Chance of a lift below which a grasp is not tried."""
_BARE = PoseParams(merge=False, recollected=0, penalty=0.0, max_violation=1.0)
"""ICP that knows nothing of free space, which stands for his baseline."""
_RULES = ("ICP alone", "with his check", "ours, by free space")


@dataclass(frozen=True, eq=False)
class _Lying:
    """A product at rest, seen by a camera; ``labels`` are segments, ``label`` its own or 0."""

    world: World
    body: int
    rest: BodyPose
    mesh: Mesh
    mass: float
    frame: Frame
    world_from_camera: Matrix
    labels: NDArray[np.int32]
    label: int
    plane: Matrix | None

    @property
    def camera_from_object(self) -> Matrix:
        """True pose."""
        return np.linalg.inv(self.world_from_camera) @ self.world_from_object

    @property
    def world_from_object(self) -> Matrix:
        """True pose on the table."""
        return pose_matrix(self.rest.rotation, self.rest.position)

    def estimate(self, model: PoseModel, params: PoseParams | None = None) -> PoseEstimate | None:
        """Estimate its pose; None where it was not segmented."""
        if not self.label:
            return None
        return estimate_pose(model, self.frame, self.labels, self.label, params, self.plane)

    def is_right(self, model: PoseModel, pose: Matrix | None) -> bool:
        """Whether a pose is within 5 mm and 5 degrees; one that is missing is not."""
        return pose is not None and pose_error(model, pose, self.camera_from_object).is_within()


@contextmanager
def _lying(name: str, number: int, seed: int) -> Iterator[_Lying]:
    """Drop a product in a drawn orientation and look at it from a drawn side."""
    spec = household(name)
    rng = np.random.default_rng([seed, spec.texture_seed, number])
    with ScratchFolder("posed") as folder, World() as world:
        world.add_table(0.0)
        assets = write_assets(spec, folder)
        body = world.spawn(spec, (0.34, 0.0), assets=assets)
        turn = Rotation.random(random_state=int(rng.integers(2**31))).as_quat().tolist()
        world.put(body, [0.34, 0.0, float(np.linalg.norm(spec.extent)) / 2 + 0.01], turn)
        rest = settle(world, body)
        azimuth, elevation = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(30, 60))
        towards = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                   np.sin(elevation)]  # fmt: skip
        pose = look_at(rest.position + _DISTANCE_M * np.array(towards), rest.position)
        exact, bodies = Camera(world.client, _CAMERA).capture(pose, Lighting.sample(rng))
        frame = SensorNoise().apply(exact, rng)
        scene = segment_scene(frame.points(), frame.rgb)
        labels = scene.labels.astype(np.int32)
        on_it = labels[(bodies == body) & (labels > 0)]
        label = int(np.bincount(on_it).argmax()) if len(on_it) else 0
        plane = None if scene.plane is None else np.append(scene.plane.normal, scene.plane.offset)
        yield _Lying(world, body, rest, read_mesh(assets.obj_path), spec.mass, frame, pose, labels,
                     label, plane)  # fmt: skip


def _notes(setting: Setting, poses: int) -> tuple[str, ...]:
    return (STAND_INS, _NOISE_NOTE, *setting.shrunk("poses of each product", _POSES, poses))


def table_4_2(setting: Setting) -> Result:
    """Wrong poses and the time of an estimate, product by product."""
    poses = setting.size(_POSES, 2)
    rows, wrong = [], 0
    for name, (his, (failed, seconds, *_)) in zip(SIX, _PUBLISHED.items(), strict=True):
        model: PoseModel | None = None
        right, spans = 0, []
        for number in range(poses):
            with _lying(name, number, setting.seed) as lying:
                model = model or build_pose_model(lying.mesh.vertices, lying.mesh.faces)
                began = time.process_time()
                estimate = lying.estimate(model)
                spans.append(time.process_time() - began)
                pose = None if estimate is None else estimate.camera_from_object
                right += lying.is_right(model, pose)
        wrong += poses - right
        what = f"{name} for {his}"
        rows.append(share_of(f"{what}: wrong poses", poses - right, poses, failed / 15,
                             better="lower"))  # fmt: skip
        rows.append(Compared(f"{what}: time of an estimate", float(np.median(spans)), seconds, "s",
                             better="lower"))  # fmt: skip
    rows.append(share_of("all: wrong poses", wrong, poses * len(SIX), 7 / 90, better="lower"))
    return Result(tuple(rows), _notes(setting, poses))


def table_4_3(setting: Setting) -> Result:
    """Grasps planned at the poses that are right, carried out at the true ones."""
    poses = setting.size(_POSES, 2)
    rows, lost, tried, without = [], 0, 0, 0
    for name, (his, (_, _, failed, of, size)) in zip(SIX, _PUBLISHED.items(), strict=True):
        model: PoseModel | None = None
        sizes, held = [], []
        for number in range(poses):
            with _lying(name, number, setting.seed) as lying:
                model = model or build_pose_model(lying.mesh.vertices, lying.mesh.faces)
                estimate = lying.estimate(model)
                if estimate is None or not lying.is_right(model, estimate.camera_from_object):
                    continue
                candidates, outcome = _grasped(lying, estimate.camera_from_object, setting.seed)
                sizes.append(candidates)
                if outcome is None:
                    without += 1
                else:
                    held.append(outcome)
        what = f"{name} for {his}"
        rows.append(share_of(f"{what}: lost grasps", held.count(False), len(held), failed / of,
                             better="lower"))  # fmt: skip
        rows.append(Compared(f"{what}: candidate grasps, median",
                             float(np.median(sizes)) if sizes else None, float(size)))  # fmt: skip
        lost, tried = lost + held.count(False), tried + len(held)
    rows.append(share_of("all: lost grasps", lost, tried, 11 / 83, better="lower"))
    rows.append(
        share_of("all: no grasp worth trying", without, tried + without, 0.0, better="lower")
    )
    notes = (f"a Panda's hand; a grasp with less than {_LEAST} chance of a lift is not tried",)
    return Result(tuple(rows), (*_notes(setting, poses), *notes))


def _grasped(lying: _Lying, believed: Matrix, seed: int) -> tuple[int, bool | None]:
    """Return the number of candidates, and whether the best held; None if none is worth trying."""
    hand = panda_hand()
    world_from_believed = lying.world_from_camera @ believed
    up = world_from_believed[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    support = Support(-float(world_from_believed[2, 3]), tuple((up / np.linalg.norm(up)).tolist()))
    options = SpatialOptions(mass=lying.mass, seed=seed)
    candidates = plan_on_mesh(lying.mesh, hand, Surroundings(support), options)
    best = next((c for c in candidates if c.scores["lift_chance"] >= _LEAST), None)
    if best is None:
        return len(candidates), None
    pose = world_from_believed @ best.frame_from_gripper
    opening = best.opening or hand.max_opening
    table = Support(0.0)
    low = table.below(pose[None], hand.boxes(opening)[None])[0]
    pose[2, 3] += max(table.clearance - low, 0.0)  # where the table is, is measured apart
    held = execute(lying.world, lying.body, hand, pose, opening, lying.rest, friction=1.0).held
    return len(candidates), bool(held)


def axis(setting: Setting) -> Result:
    """ICP alone, with the check of principal axes, and the product's own rule (4.6)."""
    poses = setting.size(_POSES, 2)
    right = dict.fromkeys(_RULES, 0)
    chosen = (SIX[0], SIX[3], SIX[4])
    for name in chosen:
        model: PoseModel | None = None
        for number in range(poses):
            with _lying(name, number, setting.seed) as lying:
                model = model or build_pose_model(lying.mesh.vertices, lying.mesh.faces)
                seen = replace(lying.frame, mask=lying.labels == lying.label)
                for rule, pose in poses_by_rule(
                    seen, model, partial(lying.estimate, model)
                ).items():
                    right[rule] += lying.is_right(model, pose)
    theirs = (6 / 10, 9 / 10, None)
    return Result(
        tuple(
            share_of(f"{rule}: right poses", hits, poses * len(chosen), his, better="higher")
            for (rule, hits), his in zip(right.items(), theirs, strict=True)
        ),
        (*_notes(setting, poses), "the objects of which 4 of 10 poses were wrong in his baseline"),
    )


def poses_by_rule(
    seen: Frame, model: PoseModel, estimate: Callable[[PoseParams | None], PoseEstimate | None]
) -> dict[str, Matrix | None]:
    """Return the pose that each rule of section 4.6 chooses; None where it chooses none.

    The check takes the best pose whose principal axis in the image is within pi/10 of what was
    measured, without a guard on the ratio of the axes, as he had none.

    Parameters
    ----------
    seen
        The view, with the mask of the object.
    estimate
        Estimates the pose with some parameters, or with those of the product for None.
    """
    full, fitted = estimate(None), estimate(_BARE)
    poses = [] if fitted is None else [
        fitted.camera_from_object, *(a.camera_from_object for a in fitted.alternatives)
    ]  # fmt: skip
    by_axis = (p for p in poses if axis_check(model, seen, p, min_ratio=1.0).passes)
    chosen = (
        poses[0] if poses else None,
        next(by_axis, None),
        None if full is None else full.camera_from_object,
    )
    return dict(zip(_RULES, chosen, strict=True))
