"""Models that ``bench_pose.py`` measures poses against: of exact meshes, and grown from views.

A model grows as in the product: each *thing* is looked at by itself, in colour, so that two things
of one geometry have two models; keypoints of its views are kept, to give a pose to begin with.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from scipy.spatial import cKDTree

from features.geometry import Frame, Intrinsics
from features.modelling import ObjectModel
from features.pose import PoseModel, build_pose_model
from features.pose.rotations import rotation_about
from features.recognition.pairs import match_views
from features.recognition.views.view import describe_frame
from tests.benchmarks.perception.tabletop_scenes import TableScene, Thing, kinect_noise
from tests.benchmarks.recognition.solid_prints import Print

__all__ = ["GrownModels", "Models", "Named", "painted"]

TURNTABLE = Intrinsics(320, 240, 430.0, 430.0, 159.5, 119.5)
DISTANCE_M = 0.5
KNOWN_M = 0.003
_AMBIENT = 0.55


@dataclass(frozen=True)
class Named:
    """One thing of one scene.

    Parameters
    ----------
    name
        Unlike its geometry's, its own.
    ink : (3,) uint8 RGB, or None
        Its colour where it carries no print.
    """

    name: str
    thing: Thing
    ink: np.ndarray | None = None

    def colours(self, places: np.ndarray) -> np.ndarray:
        """Return the colours (n, 3) uint8 RGB of places (n, 3) on it, m, mesh frame."""
        if self.ink is not None:
            return np.tile(self.ink, (len(places), 1))
        return Print(self.thing.load()[0], self.name).at(places)


def painted(scene: TableScene) -> TableScene:
    """Return a scene in which every thing carries a print of its own, shaded as it was."""
    assert scene.frame.rgb is not None
    rgb = scene.frame.rgb.copy()
    lens = scene.frame.intrinsics
    for thing in scene.things:
        own = scene.labels == thing.number
        if not own.any():
            continue
        one = Named(name_of(scene, thing), thing)
        mesh_from_camera = np.linalg.inv(thing.camera_from_mesh)
        depth = depth_of(*thing.load(), mesh_from_camera, lens)[own]
        v, u = np.nonzero(own)
        rays = np.stack([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones(len(u))], 1)
        places = depth[:, None] * rays @ mesh_from_camera[:3, :3].T + mesh_from_camera[:3, 3]
        light = rgb[own].max(axis=1) / max(float(np.percentile(rgb[own].max(axis=1), 95)), 1.0)
        shaded = one.colours(places) * np.minimum(light, 1.0)[:, None]
        rgb[own] = shaded.astype(np.uint8)
    return replace(scene, frame=replace(scene.frame, rgb=rgb))


def name_of(scene: TableScene, thing: Thing) -> str:
    """Return a name that no other thing has: where it was dropped tells it from its like."""
    place = np.rint(1e3 * thing.camera_from_mesh[:3, 3]).astype(int).tolist()
    return f"{thing.key}@{thing.number}{place}"


class Models:
    """Models of all geometries met so far, from their meshes; printed ones know their colours.

    With ``textures`` those of a mesh with a texture know its colours, as models of views do.
    """

    def __init__(self, prints: bool = False, textures: bool = False) -> None:
        self.prints, self.textures = prints, textures
        self._known: dict[str, PoseModel] = {}

    def stored(self, scene: TableScene, thing: Thing) -> PoseModel:
        """Return what poses are estimated against."""
        model = self.of(thing)
        if not self.prints:
            return model
        one = Named(name_of(scene, thing), thing)
        return replace(model, colours=one.colours(model.samples[:, :3] + model.centre))

    def begun(self, scene: TableScene, thing: Thing, mask: np.ndarray) -> np.ndarray | None:
        """Return the pose (1, 4, 4) that keypoints give; of a mesh they are not known."""
        return None

    def of(self, thing: Thing) -> PoseModel:
        """Return the model of a thing, made from its mesh."""
        if thing.key not in self._known:
            inks = _texture(thing) if self.textures else None
            self._known[thing.key] = build_pose_model(*thing.load(), colours=inks)
        return self._known[thing.key]


def _texture(thing: Thing) -> tuple[np.ndarray, np.ndarray] | None:
    """Return places (n, 3), m, on a mesh and their colours (n, 3) uint8; None without a mesh."""
    import trimesh

    if not thing.mesh:
        return None
    textured = trimesh.load(thing.mesh, force="mesh", process=False)
    places, _, inks = trimesh.sample.sample_surface(textured, 20_000, sample_color=True, seed=0)
    return places * thing.scale, np.asarray(inks)[:, :3].astype(np.uint8)


class GrownModels(Models):
    """Models that grew from the first so many views of each thing.

    ``count`` says which of them are looked up; ``joined`` is the share of the views that a model
    took in, ``known`` by count the share of each surface within 3 mm of its model.
    """

    def __init__(self, counts: list[int], prints: bool = False) -> None:
        super().__init__(prints)
        self.counts = counts
        self.count = counts[0]
        self._grown: dict[str, dict[int, ObjectModel]] = {}
        self.joined: list[float] = []
        self.known: dict[int, list[float]] = {count: [] for count in counts}

    def stored(self, scene: TableScene, thing: Thing) -> PoseModel:
        """Return what poses are estimated against."""
        return self.grown(scene, thing).pose_model()

    def begun(self, scene: TableScene, thing: Thing, mask: np.ndarray) -> np.ndarray | None:
        """Return the pose (1, 4, 4) that keypoints of the best matching view give, if any do."""
        model = self.grown(scene, thing)
        seen = describe_frame(scene.frame.crop(mask))
        matches = [(match_views(view, seen), number) for view, number in model.views]
        matches = [pair for pair in matches if pair[0].first_from_second is not None]
        if not matches:
            return None
        best, number = max(matches, key=lambda pair: int(pair[0].agreed.sum()))
        object_from_camera = model.sources[number][1] @ best.first_from_second
        return np.linalg.inv(object_from_camera)[None]

    def grown(self, scene: TableScene, thing: Thing) -> ObjectModel:
        """Return the model of a thing, grown when it is first asked for."""
        name = name_of(scene, thing)
        if name not in self._grown:
            ink = None
            if not self.prints and scene.frame.rgb is not None:
                own = scene.frame.rgb[scene.labels == thing.number]
                ink = np.percentile(own, 95, axis=0).astype(np.uint8)
            self._grown[name] = self._grow(Named(name, thing, ink))
        return self._grown[name][self.count]

    def _grow(self, one: Named) -> dict[int, ObjectModel]:
        vertices, _ = one.thing.load()
        most, exact = max(self.counts), self.of(one.thing)
        rng = np.random.default_rng([most, crc32(one.name.encode())])
        model, joined, grown = ObjectModel(), 0, {}
        poses = around(vertices, most)
        for k, which in enumerate(rng.permutation(most).tolist(), start=1):
            pose = poses[which]
            frame = pictured(one, pose, rng)
            axis = rng.normal(size=3)
            off = np.eye(4)
            off[:3, :3] = rotation_about(axis / np.linalg.norm(axis), np.deg2rad(rng.normal()))
            off[:3, 3] = rng.normal(0, 0.002 / np.sqrt(3), 3)
            told = pose if model.is_empty else pose @ off
            model, found = model.add(
                frame, describe_frame(frame), object_from_camera=told, is_measured=True
            )
            joined += found is not None
            if k in self.counts:
                grown[k] = model
                away, _ = cKDTree(model.cloud[:, :3]).query(exact.samples[:, :3] + exact.centre)
                self.known[k].append(float((away < KNOWN_M).mean()))
        self.joined.append(joined / most)
        return grown


def pictured(one: Named, object_from_camera: np.ndarray, rng: np.random.Generator) -> Frame:
    """Return what the turntable's camera shows of a thing, lit from beside the camera."""
    vertices, faces = one.thing.load()
    exact = depth_of(vertices, faces, object_from_camera, TURNTABLE)
    points = Frame(exact.astype(np.float32), TURNTABLE).points().astype(np.float64)
    own = exact > 0
    across, down = (np.gradient(points, axis=axis) for axis in (1, 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = np.cross(across, down)
        normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    facing = np.nan_to_num(np.abs(normal[..., 2]), nan=0.5)[own]
    places = points[own] @ object_from_camera[:3, :3].T + object_from_camera[:3, 3]
    rgb = np.full((*own.shape, 3), 245, np.uint8)
    rgb[own] = (one.colours(places) * (_AMBIENT + (1 - _AMBIENT) * facing)[:, None]).astype(
        np.uint8
    )
    measured = kinect_noise(exact, TURNTABLE.fx, rng)
    return Frame(measured, TURNTABLE, rgb)


def around(vertices: np.ndarray, count: int) -> list[np.ndarray]:
    """Return poses of cameras spread over the sphere around an object."""
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    k = np.arange(count) + 0.5
    height, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    poses = []
    for z, a in zip(height, turn, strict=True):
        forward = -np.array([np.sqrt(1 - z * z) * np.cos(a), np.sqrt(1 - z * z) * np.sin(a), z])
        right = np.cross(forward, [0, 0, 1.0] if abs(z) < 0.95 else [1.0, 0, 0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        pose[:3, 3] = centre - DISTANCE_M * forward
        poses.append(pose)
    return poses


def depth_of(
    vertices: np.ndarray, faces: np.ndarray, object_from_camera: np.ndarray, lens: Intrinsics
) -> np.ndarray:
    """Return the exact depth (h, w), m, of a mesh; 0 beside it."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    tensor = o3d.core.Tensor
    scene.add_triangles(tensor(vertices.astype(np.float32)), tensor(faces.astype(np.uint32)))
    v, u = np.mgrid[0 : lens.height, 0 : lens.width]
    ways = np.stack([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, np.ones(u.shape)], -1)
    eye, turn = object_from_camera[:3, 3], object_from_camera[:3, :3]
    rays = np.concatenate([np.broadcast_to(eye, ways.shape), ways @ turn.T], -1)
    met = scene.cast_rays(tensor(rays.astype(np.float32)))["t_hit"].numpy()
    return np.where(np.isfinite(met), met, 0.0)
