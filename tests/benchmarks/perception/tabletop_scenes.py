"""Simulated tables with everything known: masks, identities, poses (version 1 of the generator).

A table of 1.0 x 0.8 m, five to twelve objects dropped on it, a Kinect-like camera at 0.75 to 1.05 m
with its noise. Kinds: ``prim`` (boxes, cylinders, balls, mugs), ``primsmall`` (the same, 1.4 to
7 cm), ``primstacked`` (piles), ``normal`` (meshes that come with the physics engine, many of them
strongly concave), ``ycb`` (household objects, where their models are at hand). The same kind and
seed give the same scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, Intrinsics

KINDS = ("prim", "primsmall", "primstacked", "normal", "ycb")
CAMERA = Intrinsics.from_fov(640, 480, 1.2)
NEAR_M, FAR_M = 0.05, 8.0
NAMED = (
    "duck_vhacd.urdf",
    "objects/mug.urdf",
    "lego/lego.urdf",
    "jenga/jenga.urdf",
    "domino/domino.urdf",
    "cube_small.urdf",
    "teddy_vhacd.urdf",
)


@dataclass(frozen=True, eq=False)
class Thing:
    """One object: its number in the label image, mesh file (or primitive) and pose."""

    number: int
    source: str
    mesh: str
    scale: NDArray[np.float64]
    camera_from_mesh: NDArray[np.float64]
    pixels: int

    @property
    def key(self) -> str:
        """Name of the geometry: equal for equal ones."""
        return f"{self.mesh or self.source}*{self.scale.round(6).tolist()}"

    def load(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return vertices (m) and faces of the mesh."""
        if self.mesh:
            vertices, faces = read_obj(Path(self.mesh))
            return vertices * self.scale, faces
        kind, _, numbers = self.source.partition(":")
        size = [float(n) for n in numbers.split(",")]
        if kind == "box":
            return box_mesh(np.array(size))
        if kind == "cylinder":
            return turned_mesh([0, size[0], size[0], 0], np.array([-1, -1, 1, 1]) * size[1] / 2)
        angle = np.linspace(-np.pi / 2, np.pi / 2, 25)
        return turned_mesh(size[0] * np.cos(angle), size[0] * np.sin(angle))


def read_obj(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices and triangles of a Wavefront file; polygons are fanned out."""
    vertices, faces = [], []
    for line in path.read_text("utf-8", "replace").splitlines():
        kind, *rest = line.split() or [""]
        if kind == "v":
            vertices.append([float(x) for x in rest[:3]])
        elif kind == "f":
            corners = [int(x.partition("/")[0]) for x in rest]
            corners = [c - 1 if c > 0 else len(vertices) + c for c in corners]
            faces += [[corners[0], b, c] for b, c in pairwise(corners[1:])]
    return np.array(vertices), np.array(faces)


def box_mesh(half: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a box about the origin."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return signs * half, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])


def turned_mesh(radius: Any, height: Any) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the body that a profile makes when it turns about z, from bottom to top."""
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rings = [np.stack([r * np.cos(turn), r * np.sin(turn), z + 0 * turn], axis=1)
             for r, z in zip(radius, height, strict=True)]  # fmt: skip
    faces = []
    for k in range(len(rings) - 1):
        for i in range(48):
            a, b = 48 * k + i, 48 * k + (i + 1) % 48
            faces += [(a, b, b + 48), (a, b + 48, a + 48)]
    return np.concatenate(rings), np.array(faces)


@dataclass(frozen=True, eq=False)
class TableScene:
    """A noisy frame and the truth.

    ``labels`` (h, w): number of the object, 0 table, -1 nothing. ``plane`` (4,): the table in the
    camera's frame. ``world_from_camera`` (4, 4): z of the world is up.
    """

    frame: Frame
    labels: NDArray[np.int32]
    things: tuple[Thing, ...]
    plane: NDArray[np.float64]
    down: NDArray[np.float64]
    world_from_camera: NDArray[np.float64]


def make_scene(
    kind: str, seed: int, ycb: Path | None = None, clean: bool = False, alone: str = ""
) -> TableScene:
    """Drop objects, wait until they lie still, take a picture.

    With ``alone``, the name of one YCB object, only that one is dropped.
    """
    return make_views(kind, seed, 1, ycb, clean, alone)[0]


def make_views(
    kind: str, seed: int, count: int, ycb: Path | None = None, clean: bool = False, alone: str = ""
) -> list[TableScene]:
    """Drop objects as :func:`make_scene` does, and take pictures from all round the table."""
    from simulate.world.world import World

    if kind not in KINDS:
        raise ValueError(f"unknown kind {kind!r}: expected one of {KINDS}")
    rng = np.random.default_rng([seed, *kind.encode()])
    with World() as world:
        client = world.client
        import pybullet_data

        client.setAdditionalSearchPath(pybullet_data.getDataPath())
        client.setGravity(0, 0, -9.81)
        client.setTimeStep(1 / 240)
        half = [0.5, 0.4, 0.02]
        table = client.createMultiBody(
            0,
            client.createCollisionShape(client.GEOM_BOX, halfExtents=half),
            client.createVisualShape(
                client.GEOM_BOX, halfExtents=half, rgbaColor=[0.6, 0.5, 0.4, 1]
            ),
            [0, 0, -0.02],
        )
        bodies = _drop(client, kind, rng, ycb, alone)
        for _ in range(480):
            client.stepSimulation()
        first = float(rng.uniform(0, 2 * np.pi))
        return [
            _picture(client, table, bodies, rng, clean, first + 2 * np.pi * k / count)
            for k in range(count)
        ]


def _drop(
    client: Any, kind: str, rng: np.random.Generator, ycb: Path | None, alone: str
) -> dict[int, str]:
    reach = 0.16 if kind == "primstacked" else 0.26
    bodies: dict[int, str] = {}
    for k in range(1 if alone else int(rng.integers(5, 13))):
        angle, r = rng.uniform(0, 2 * np.pi), reach * np.sqrt(rng.random())
        turn = rng.uniform(-np.pi, np.pi, 3)
        place = [r * np.cos(angle), 0.8 * r * np.sin(angle), 0.06 + 0.05 * k]
        if kind.startswith("prim"):
            place[2] = 0.08 + 0.07 * k
            if rng.random() < 0.7:
                turn[:2] = 0
            scale = float(rng.uniform(0.35, 0.5)) if kind == "primsmall" else 1.0
            body, source = _primitive(client, rng, scale)
        elif kind == "ycb":
            assert ycb is not None
            client.setAdditionalSearchPath(str(ycb))
            names = sorted(p.name for p in ycb.glob("*.urdf"))
            source = f"{alone}.urdf" if alone else str(rng.choice(names))
            body = client.loadURDF(source)
        else:
            named = rng.random() < 0.35
            one, other = rng.integers(len(NAMED)), rng.integers(1000)
            source = NAMED[one] if named else f"random_urdfs/{other:03d}/{other:03d}.urdf"
            body = client.loadURDF(source)
            client.changeVisualShape(body, -1, rgbaColor=[*rng.uniform(0.15, 1, 3), 1])
        client.resetBasePositionAndOrientation(
            body, place, client.getQuaternionFromEuler(turn.tolist())
        )
        bodies[body] = source
    return bodies


def _primitive(client: Any, rng: np.random.Generator, scale: float) -> tuple[int, str]:
    kind = ("box", "cylinder", "ball", "mug")[rng.choice(4, p=[0.5, 0.28, 0.12, 0.1])]
    size = rng.uniform(0, 1, 3)
    if kind == "mug":
        return client.loadURDF("objects/mug.urdf", globalScaling=scale), "objects/mug.urdf"
    if kind == "box":
        half = ((0.02 + 0.055 * size) * scale).tolist()
        solid = shown = {"shapeType": client.GEOM_BOX, "halfExtents": half}
        source = f"box:{half[0]:.5f},{half[1]:.5f},{half[2]:.5f}"
    elif kind == "cylinder":
        radius, length = (0.02 + 0.025 * size[0]) * scale, (0.06 + 0.08 * size[1]) * scale
        solid = {"shapeType": client.GEOM_CYLINDER, "radius": radius, "height": length}
        shown = {"shapeType": client.GEOM_CYLINDER, "radius": radius, "length": length}
        source = f"cylinder:{radius:.5f},{length:.5f}"
    else:
        radius = (0.025 + 0.02 * size[0]) * scale
        solid = shown = {"shapeType": client.GEOM_SPHERE, "radius": radius}
        source = f"ball:{radius:.5f}"
    colour = [*rng.uniform(0.15, 1, 3), 1]
    body = client.createMultiBody(
        0.2,
        client.createCollisionShape(**solid),
        client.createVisualShape(**shown, rgbaColor=colour),
    )
    client.changeDynamics(body, -1, rollingFriction=0.005, spinningFriction=0.005)
    return body, source


def _picture(
    client: Any, table: int, bodies: dict[int, str], rng: np.random.Generator, clean: bool,
    azimuth: float,
) -> TableScene:  # fmt: skip
    elevation = np.radians(rng.uniform(35, 60))
    distance = rng.uniform(0.75, 1.05)
    eye = distance * np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    view = client.computeViewMatrix(eye.tolist(), [0, 0, 0.03], [0, 0, 1])
    fov = float(np.degrees(2 * np.arctan(CAMERA.height / 2 / CAMERA.fy)))
    projection = client.computeProjectionMatrixFOV(fov, 4 / 3, NEAR_M, FAR_M)
    _, _, rgba, buffer, seen = client.getCameraImage(
        *(CAMERA.width, CAMERA.height, view, projection),
        shadow=0,
        renderer=client.ER_TINY_RENDERER,
    )
    shape = (CAMERA.height, CAMERA.width)
    rgb = np.asarray(rgba, np.uint8).reshape(*shape, 4)[..., :3].copy()
    seen = np.asarray(seen, np.int32).reshape(shape)
    share = np.asarray(buffer, np.float64).reshape(shape)
    depth = np.where(share < 1, FAR_M * NEAR_M / (FAR_M - (FAR_M - NEAR_M) * share), 0.0)
    camera_from_world = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.reshape(view, (4, 4)).T
    numbers = {body: k for k, body in enumerate(bodies, start=1)}
    labels = np.where(seen == table, 0, -1).astype(np.int32)
    for body, number in numbers.items():
        labels[seen == body] = number
    things = tuple(
        _thing(client, body, number, bodies[body], camera_from_world, labels)
        for body, number in numbers.items()
    )
    measured = depth.astype(np.float32) if clean else kinect_noise(depth, CAMERA.fx, rng)
    up = camera_from_world[:3, 2]
    plane = np.append(up, -float(up @ camera_from_world[:3, 3]))
    back = np.linalg.inv(camera_from_world)
    return TableScene(Frame(measured, CAMERA, rgb), labels, things, plane, -up, back)


def _thing(
    client: Any,
    body: int,
    number: int,
    source: str,
    camera_from_world: NDArray[np.float64],
    labels: NDArray[np.int32],
) -> Thing:
    """Describe a body; the engine reports centres of mass, meshes hang on the link's frame."""
    shape = client.getVisualShapeData(body)[0]
    inertial = client.getDynamicsInfo(body, -1)
    back = client.invertTransform(inertial[3], inertial[4])
    link = client.multiplyTransforms(*client.getBasePositionAndOrientation(body), *back)
    mesh = shape[4].decode() if shape[2] == client.GEOM_MESH else ""
    if not mesh and source.endswith(".urdf"):
        half = np.asarray(shape[3]) / 2
        source = f"box:{half[0]:.5f},{half[1]:.5f},{half[2]:.5f}"
    return Thing(
        number,
        source,
        mesh,
        np.asarray(shape[3], np.float64) if mesh else np.ones(3),
        camera_from_world @ _matrix(client, *link) @ _matrix(client, shape[5], shape[6]),
        int(np.count_nonzero(labels == number)),
    )


def _matrix(client: Any, position: Any, quaternion: Any) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = np.reshape(client.getMatrixFromQuaternion(quaternion), (3, 3))
    pose[:3, 3] = position
    return pose


def kinect_noise(
    depth_m: NDArray[np.float64], focal_px: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return depth as a structured-light sensor at 0.5 to 1.5 m measures it.

    Jitter of a quarter pixel, axial noise sigma(z) = 1.2 mm + 1.9 mm ((z - 0.4 m) / m)^2 (Nguyen,
    Izadi and Lovell 2012) that neighbours share, disparity in eighths of a pixel on a baseline of
    75 mm, half of the pixels lost at edges.
    """
    exact = np.where(depth_m > 0, depth_m, 5.0).astype(np.float32)
    h, w = exact.shape
    v, u = np.mgrid[0:h, 0:w].astype(np.float32)
    du, dv = rng.normal(0, 0.25, (2, h, w)).astype(np.float32)
    depth = cv2.remap(exact, u + du, v + dv, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    shared = cv2.GaussianBlur(rng.normal(0, 1, (h, w)).astype(np.float32), (0, 0), 0.8)
    depth = depth + 0.8 * (0.0012 + 0.0019 * (depth - 0.4) ** 2) * shared / shared.std()
    disparity = np.round(focal_px * 0.075 / depth * 8) / 8
    depth = focal_px * 0.075 / disparity
    jump = np.abs(np.diff(exact, axis=1, prepend=exact[:, :1]))
    jump = np.maximum(jump, np.abs(np.diff(exact, axis=0, prepend=exact[:1])))
    edge = cv2.dilate((jump > 0.03).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    lost = (edge & (rng.random((h, w)) < 0.5)) | (rng.random((h, w)) < 0.002)
    lost |= (depth > 4) | (depth < 0.3)
    return np.where(lost, 0, depth).astype(np.float32)
