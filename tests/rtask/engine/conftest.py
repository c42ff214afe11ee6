"""A table with textured things on it, seen by a camera, and robots that talk to an engine.

The pictures are cast ray by ray from boxes and cylinders, so that shapes, poses and pixels are
known exactly and no simulator is needed.
"""

from __future__ import annotations

import base64
import copy
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import rtask
from features.codec import encode_frame, to_wire
from features.geometry import Frame, Intrinsics
from features.modelling import grow
from features.pose.model import PoseModel
from grasp.messages import pose_message
from rtask.engine import Engine
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase

CAMERA = Intrinsics.from_fov(640, 480, 1.2)
TABLE = 0.27
BASE = "https://example.org/kb/"


@dataclass(frozen=True)
class Thing:
    """Something on the table: a box (length, width, height), or a cylinder when it is round."""

    size: tuple[float, float, float]
    is_round: bool = False
    texture_seed: int = 0
    position: tuple[float, float] = (0.16, -0.06)
    yaw: float = 0.3

    def at(self, x: float, y: float, yaw: float) -> Thing:
        """Return the same thing elsewhere."""
        return replace(self, position=(x, y), yaw=yaw)


@dataclass(frozen=True)
class Eye:
    """Camera of the tests: its place and the point it looks at, base frame, m."""

    position: tuple[float, float, float] = (0.02, 0.0, 0.58)
    target: tuple[float, float, float] = (0.16, -0.06, TABLE)
    noise_seed: int = 0

    def base_from_camera(self) -> NDArray[np.float64]:
        """Return the pose of the optical frame (4, 4)."""
        origin = np.array(self.position)
        forward = np.array(self.target) - origin
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        pose[:3, 3] = origin
        return pose


def texture(seed: int) -> NDArray[np.uint8]:
    """Return a picture (512, 512, 3) full of corners that no other seed shares."""
    rng = np.random.default_rng(seed)
    image = np.full((512, 512, 3), rng.integers(60, 200, 3), np.uint8)
    for _ in range(260):
        colour = tuple(int(v) for v in rng.integers(0, 256, 3))
        x, y = (int(v) for v in rng.integers(0, 512, 2))
        w, h = (int(v) for v in rng.integers(6, 46, 2))
        if rng.random() < 0.6:
            cv2.rectangle(image, (x, y), (x + w, y + h), colour, -1)
        else:
            cv2.circle(image, (x, y), w // 2, colour, -1)
    return image


def look(thing: Thing, eye: Eye) -> Frame:
    """Return the whole frame that a camera sees, with the thing's mask."""
    pose = eye.base_from_camera()
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width].astype(np.float64)
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], -1)
    directions = rays.reshape(-1, 3) @ pose[:3, :3].T
    depth_table = (TABLE - pose[2, 3]) / directions[:, 2]
    c, s = np.cos(thing.yaw), np.sin(thing.yaw)
    object_from_base = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    origin = object_from_base @ (pose[:3, 3] - [*thing.position, TABLE])
    local = directions @ object_from_base.T
    depth, uv, shade = (_cylinder if thing.is_round else _box)(origin, local, thing.size)
    mask = np.isfinite(depth)
    picture = np.full((len(depth), 3), 150.0)
    pixels = np.clip((uv[mask] * 511).astype(int), 0, 511)
    picture[mask] = texture(thing.texture_seed)[pixels[:, 1], pixels[:, 0]] * shade[mask, None]
    rng = np.random.default_rng(eye.noise_seed)
    picture = np.clip(picture + rng.normal(0, 2.0, picture.shape), 0, 255).astype(np.uint8)
    shape = (CAMERA.height, CAMERA.width)
    whole = np.where(mask, depth, depth_table).astype(np.float32).reshape(shape)
    whole += rng.normal(0, 3e-4, shape).astype(np.float32)
    return Frame(whole, CAMERA, picture.reshape(*shape, 3), mask.reshape(shape), frame_id="optical")


def _box(origin, directions, size):  # type: ignore[no-untyped-def]
    """Cast rays at an upright box; return depth (inf = missed), texture coordinates, shade."""
    low, high = (
        np.array([-size[0] / 2, -size[1] / 2, 0]),
        np.array([size[0] / 2, size[1] / 2, size[2]]),
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / directions, (high - origin) / directions
    near, far = np.minimum(a, b), np.maximum(a, b)
    enter, leave = near.max(axis=1), far.min(axis=1)
    depth = np.where((enter < leave) & (enter > 0), enter, np.inf)
    axis = near.argmax(axis=1)
    hit = origin + directions * np.where(np.isfinite(depth), depth, 0)[:, None]
    share = (hit - low) / (high - low)
    side = (hit[np.arange(len(hit)), axis] > 0).astype(float)
    first, second = np.where(axis == 0, 1, 0), np.where(axis == 2, 1, 2)
    rows = np.arange(len(hit))
    tile = axis * 2 + side  # every face has its own part of the texture
    uv = np.stack([(tile % 3 + share[rows, first]) / 3, (tile // 3 + share[rows, second]) / 2], 1)
    return depth, uv, np.array([0.8, 0.7, 1.0])[axis]


def _cylinder(origin, directions, size):  # type: ignore[no-untyped-def]
    radius, height = size[0] / 2, size[2]
    a = (directions[:, :2] ** 2).sum(1)
    b = 2 * directions[:, :2] @ origin[:2]
    root = b**2 - 4 * a * (origin[:2] @ origin[:2] - radius**2)
    with np.errstate(invalid="ignore"):
        t = (-b - np.sqrt(root)) / (2 * a)
    z = origin[2] + t * directions[:, 2]
    wall = np.where((root > 0) & (z >= 0) & (z <= height), t, np.inf)
    t_top = (height - origin[2]) / directions[:, 2]
    on_top = ((origin[:2] + directions[:, :2] * t_top[:, None]) ** 2).sum(1) <= radius**2
    top = np.where(on_top, t_top, np.inf)
    depth = np.minimum(wall, top)
    hit = origin + directions * np.where(np.isfinite(depth), depth, 0)[:, None]
    around = np.arctan2(hit[:, 1], hit[:, 0]) / (2 * np.pi) + 0.5
    on_wall = np.stack([around, 0.5 * hit[:, 2] / height], axis=1)
    above = np.stack([0.25 + hit[:, 0] / radius / 8, 0.75 + hit[:, 1] / radius / 8], axis=1)
    uv = np.where((top < wall)[:, None], above, on_wall)
    return depth, uv, np.where(top < wall, 1.0, 0.75)


def sight(thing: Thing, eye: Eye | None = None) -> dict[str, Any]:
    """Return what a robot sends about a thing: crop, camera pose, frame, table."""
    eye = eye or Eye(target=(*thing.position, TABLE))
    return {
        "data": _crop(thing, eye),
        "sensor_pose": pose_message(eye.base_from_camera()),
        "frame_id": "base_footprint",
        "support_height": TABLE,
    }


@lru_cache
def _crop(thing: Thing, eye: Eye) -> str:
    frame = look(thing, eye)
    assert frame.mask is not None
    return to_wire(encode_frame(frame.crop(frame.mask)))


BOX = Thing((0.046, 0.032, 0.055), texture_seed=1)
CAN = Thing((0.036, 0.036, 0.080), is_round=True, texture_seed=2, yaw=0.0)
PEN = Thing((0.110, 0.018, 0.018), texture_seed=3)


@dataclass
class Robot:
    """A robot program without a robot: it asks, and reports what it is told to report."""

    name: str
    engine: Engine
    gripper: str = "right_hand"
    log: list[dict[str, Any]] = field(default_factory=list)

    @property
    def access(self) -> Access:
        return Access(self.name, "robot")

    def call(self, operation: str, /, **args: Any) -> dict[str, Any]:
        return self.engine.call(operation, args, self.access).as_json()

    def register(self, gripper_type: str = "nao_hand") -> dict[str, Any]:
        return self.call("register_robot", **registration(self.name, self.gripper, gripper_type))

    def recognise(self, seen: dict[str, Any], **more: Any) -> dict[str, Any]:
        args = {"task": "pick", "gripper_id": self.gripper, "propose": True, "max_grasps": 50}
        answer = self.call("recognise_for_grasp", **{**args, **seen, **more})
        self.log.append(answer)
        return answer

    def insert(self, seen: dict[str, Any], **item: Any) -> dict[str, Any]:
        item = {**seen, "gripper_id": self.gripper, **item}
        return self.call("insert_object", objects=[item])


def registration(name: str, gripper: str, gripper_type: str = "nao_hand") -> dict[str, Any]:
    """Return what a small humanoid says about itself."""
    return {
        "name": name,
        "model": "nao-h25-v5",
        "simulated": True,
        "end_effectors": [
            {"name": gripper, "gripper_type": gripper_type, "kind": "Hand", "min_opening": 0.0,
             "max_opening": 0.05, "jaw_width": 0.0124, "finger_length": 0.05, "max_force": 3.0,
             "max_payload": 0.3, "parent_link": "r_wrist", "planning_group": "right_arm"},
        ],
        "cameras": [
            {"name": "depth", "frame_id": "optical", "width": 640, "height": 480, "fx": 467.7,
             "fy": 467.7, "cx": 319.5, "cy": 239.5, "min_range": 0.15, "max_range": 3.0},
        ],
        "frames": ["base_footprint", "torso"],
    }  # fmt: skip


def held(**more: Any) -> dict[str, Any]:
    """Return the outcome of a grasp that held."""
    return {"success": True, "placed": True, "reason": "ok", "lifted_m": 0.06, "slip": 0.001,
            "duration_s": 8.0, "links_touching": 6, "contact_force": 2.5, "preset": "faithful",
            "seed": 5, "attempt_number": 1, **more}  # fmt: skip


def missed(**more: Any) -> dict[str, Any]:
    """Return the outcome of a grasp that closed on nothing."""
    return {"success": False, "placed": False, "reason": "missed", "preset": "faithful",
            "duration_s": 6.0, "attempt_number": 1, **more}  # fmt: skip


def png(seed: int = 0) -> str:
    """Return a small picture as base64 PNG."""
    done, data = cv2.imencode(".png", texture(seed)[:60, :80])
    assert done
    return base64.b64encode(data.tobytes()).decode()


class Bench:
    """Names that the tests take from here; pytest's import mode keeps test modules apart."""

    Thing, Eye, Robot = Thing, Eye, Robot
    BOX, CAN, PEN, TABLE = BOX, CAN, PEN, TABLE
    look = staticmethod(look)
    sight = staticmethod(sight)
    held = staticmethod(held)
    missed = staticmethod(missed)
    png = staticmethod(png)
    registration = staticmethod(registration)
    texture = staticmethod(texture)


@pytest.fixture(scope="session")
def bench() -> type[Bench]:
    return Bench


@pytest.fixture(scope="session", autouse=True)
def pose_models() -> Iterator[None]:
    """Build the pose model of a cloud once: most tests show the same box, .2 s each time.

    What is built from equal clouds is equal, and nobody changes it.
    """
    build, built = grow.build_pose_model, {}

    def remembered(vertices: NDArray[Any], **given: Any) -> PoseModel:
        arrays = [vertices, given["normals"], *given["colours"]]
        key = (given["grid"], given["noise_m"], *(array.tobytes() for array in arrays))
        if key not in built:
            built[key] = build(vertices, **given)
        return built[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(grow, "build_pose_model", remembered)
        yield


@pytest.fixture(scope="module")
def filled_folder(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Any]:
    """A folder that the module's ``fill_store(bench, robots)`` has filled, and what it returned.

    It is filled once, since each view of an object that is inserted takes .4 s of processor time;
    a copy is opened in .1 s.
    """
    folder = tmp_path_factory.mktemp("filled") / "kb"
    with rtask.open(folder, base=BASE, reason=False) as kb, Engine(kb) as engine:
        returned = request.module.fill_store(Bench, maker_of_robots(engine))
    return folder, returned


@pytest.fixture
def kb(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[KnowledgeBase]:
    """Return a store with the ontology and without a reasoner, which opens faster.

    It is a copy of the module's ``filled_folder`` for tests that use ``filled``.
    """
    place = ":memory:"
    if "filled" in request.fixturenames:
        source, _ = request.getfixturevalue("filled_folder")
        place = str(tmp_path_factory.mktemp("copy") / "kb")
        shutil.copytree(source, place)
    with rtask.open(place, base=BASE, reason=False) as opened:
        yield opened


@pytest.fixture
def filled(kb: KnowledgeBase, filled_folder: tuple[Path, Any]) -> Any:
    """Return what ``fill_store`` returned; the test's store is its own copy of what it filled."""
    return copy.deepcopy(filled_folder[1])


@pytest.fixture
def engine(kb: KnowledgeBase) -> Iterator[Engine]:
    with Engine(kb) as made:
        yield made


def maker_of_robots(engine: Engine) -> Callable[..., Robot]:
    """Return what makes registered robots."""

    def make(name: str = "nao-1", **options: Any) -> Robot:
        robot = Robot(name, engine)
        robot.register(**options)
        return robot

    return make


@pytest.fixture
def robots(engine: Engine) -> Callable[..., Robot]:
    """Return a maker of registered robots."""
    return maker_of_robots(engine)
