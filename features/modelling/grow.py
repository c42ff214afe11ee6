"""One cloud of an object, grown from registered views (Kehoe 2014, 4.3: models from scans).

The first view gives the object's frame. A later view joins when its movement is known, or follows
from matched keypoints or from its shape, and when its points then lie on what is known already:
a view that does not fit is refused rather than smeared over the model.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from features.geometry import Frame, Intrinsics
from features.modelling.surface import surface_of
from features.pose.estimate import PoseParams, estimate_pose
from features.pose.icp import distances
from features.pose.model import PoseModel, build_pose_model
from features.pose.rotations import angle_between, rotation_about
from features.pose.search import Poses, refine, scene_points
from features.pose.visibility import check_free_space
from features.recognition.pairs import match_views
from features.recognition.view import ViewFeatures

__all__ = ["ObjectModel", "Registration", "warm_up"]

_VOXEL_M = 0.0015
_MOST_KEPT = 40_000
_MOST_POINTS = 6000
_OVERLAP_M = 0.004
_LEAST_OVERLAP = 0.35
_LEAST_FIT = 0.45
_GRAZING = 0.25
_MOST_VIOLATION, _LEAST_JUDGED = 0.12, 0.25
_MOST_DRIFT_M, _MOST_DRIFT_RAD = 0.015, np.deg2rad(12.0)
_MODEL_GRID = 48
_AROUND, _SMOOTH_M, _ALIKE = 32, 0.005, 0.8
_MOST_CELLS = 160


@dataclass(frozen=True, eq=False)
class Registration:
    """How a view came to the model.

    Parameters
    ----------
    object_from_camera : (4, 4) float64, m
    how
        ``first``, ``given``, ``keypoints`` or ``shape``.
    overlap
        Share of the view's points that lay on the model already.
    violation
        Share of the model's visible side that the view contradicts.
    """

    object_from_camera: NDArray[np.float64]
    how: str
    overlap: float
    violation: float = 0.0


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """What is known of an object's surface. Adding returns a new model.

    Parameters
    ----------
    cloud : (n, 6) float32
        Places (m, object frame) and outward normals, at most one in 1.5 mm, and at most 40,000:
        what is larger is kept more coarsely.
    colours : (n, 3) uint8 RGB
    weights : (n,) float32
        Measurements behind each point.
    views : tuple of (ViewFeatures, object_from_camera (4, 4))
        Registered ones: later views are matched with them.
    sources : tuple of (name, object_from_camera (4, 4))
        Every view that is in it, in the order in which they came.

    Examples
    --------
    >>> ObjectModel().is_empty
    True
    """

    cloud: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 6), np.float32))
    colours: NDArray[np.uint8] = field(default_factory=lambda: np.empty((0, 3), np.uint8))
    weights: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))
    views: tuple[tuple[ViewFeatures, NDArray[np.float64]], ...] = ()
    sources: tuple[tuple[str, NDArray[np.float64]], ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether no view was added."""
        return len(self.cloud) == 0

    def add(
        self,
        frame: Frame,
        features: ViewFeatures | None = None,
        object_from_camera: NDArray[np.float64] | None = None,
        name: str = "",
        is_exact: bool = False,
    ) -> tuple[ObjectModel, Registration | None]:
        """Register a view and take its points in.

        Parameters
        ----------
        frame
            Of the object: its mask, or its depth, says which pixels. Depth outside the mask counts
            as what the sensor saw there: it can contradict a movement.
        features
            Described from the same frame; lets keypoints give the movement.
        object_from_camera : (4, 4) float64, optional
            The movement, where it is known; it is refined.
        name
            Of the view, kept in :attr:`sources`.
        is_exact
            The movement was measured, as on a turntable: it holds even where the view shows too
            little of what is known to improve it, unless free space contradicts it.

        Returns
        -------
        ObjectModel
            The same one when the view was refused.
        Registration or None
            None when it was refused.
        """
        oriented, colours = _oriented(frame)
        if len(oriented) < 30:
            return self, None
        if self.is_empty:
            pose = np.eye(4) if object_from_camera is None else object_from_camera
            found: Registration | None = Registration(pose, "first", 1.0)
        else:
            found = self._registered(frame, oriented, features, object_from_camera)
            if found is None and is_exact and object_from_camera is not None:
                found = self._taken_at_its_word(frame, object_from_camera)
        if found is None:
            return self, None
        pose = found.object_from_camera
        moved = np.hstack(
            [oriented[:, :3] @ pose[:3, :3].T + pose[:3, 3], oriented[:, 3:] @ pose[:3, :3].T]
        )
        cloud, inks, weights = _merged(self, moved.astype(np.float32), colours)
        views = self.views if features is None else (*self.views, (features, pose))
        sources = (*self.sources, (name, pose))
        return ObjectModel(cloud, inks, weights, views, sources), found

    def _taken_at_its_word(
        self, frame: Frame, object_from_camera: NDArray[np.float64]
    ) -> Registration | None:
        """Return a movement as it was given, unless view and model contradict each other."""
        model = self.pose_model()
        camera_from_object = np.linalg.inv(object_from_camera).astype(np.float64)
        rotation = camera_from_object[:3, :3]
        translation = camera_from_object[:3, 3] + rotation @ model.centre
        violation = _violation(model, frame, rotation, translation)
        if violation > _MOST_VIOLATION:
            return None
        return Registration(object_from_camera, "given", 0.0, violation)

    def pose_model(self, is_round: bool = False) -> PoseModel:
        """Return what poses are estimated against; made once.

        Parameters
        ----------
        is_round
            About the z axis of its frame: then every side is known that one view showed.

        Raises
        ------
        ValueError
            When the model is empty or of no object's size.
        """
        return self._round_pose_model if is_round else self._pose_model

    @cached_property
    def _pose_model(self) -> PoseModel:
        cloud = _smoothed(self.cloud)
        return build_pose_model(cloud[:, :3], normals=cloud[:, 3:], grid=_MODEL_GRID)

    @cached_property
    def _round_pose_model(self) -> PoseModel:
        return self.revolved()._pose_model

    def revolved(self, most: int = 600, steps: int = 24) -> ObjectModel:
        """Return the body that a round object's surface sweeps about the z axis of its frame.

        Parameters
        ----------
        most
            Of its points that are swept.
        steps
            Copies, evenly turned.
        """
        rng = np.random.default_rng(0)
        rows = np.sort(rng.permutation(len(self.cloud))[:most])
        turns = np.stack(
            [rotation_about(np.array([0.0, 0.0, 1.0]), 2 * np.pi * k / steps) for k in range(steps)]
        )
        swept = [
            np.einsum("kij,nj->kni", turns, self.cloud[rows, part].astype(np.float64))
            for part in (slice(0, 3), slice(3, 6))
        ]
        cloud = np.concatenate(swept, axis=2).reshape(-1, 6).astype(np.float32)
        return ObjectModel(
            cloud, np.tile(self.colours[rows], (steps, 1)), np.tile(self.weights[rows], steps)
        )

    def mesh(
        self, cell_m: float = 0.003
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
        """Return vertices (v, 3) m, faces (f, 3), colours (v, 3); open where nothing was seen."""
        size = np.ptp(self.cloud[:, :3], axis=0).max() if len(self.cloud) else 0.0
        return surface_of(self.cloud, self.colours, max(cell_m, float(size) / _MOST_CELLS))

    def to_bytes(self) -> bytes:
        """Return an ``.npz`` of the cloud and its sources; views are kept by whoever has them."""
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer,
            cloud=self.cloud.astype("<f4"),
            colours=self.colours,
            weights=self.weights.astype("<f4"),
            names=np.array([name for name, _ in self.sources], np.str_),
            poses=np.array([pose for _, pose in self.sources], "<f8").reshape(-1, 4, 4),
        )
        return buffer.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> ObjectModel:
        """Read what :meth:`to_bytes` wrote."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                cloud = arrays["cloud"].astype(np.float32).reshape(-1, 6)
                poses = arrays["poses"].astype(np.float64).reshape(-1, 4, 4)
                return cls(
                    cloud,
                    arrays["colours"].astype(np.uint8).reshape(len(cloud), 3),
                    arrays["weights"].astype(np.float32).reshape(len(cloud)),
                    sources=tuple(zip(arrays["names"].tolist(), poses, strict=True)),
                )
        except (zipfile.BadZipFile, KeyError, OSError, EOFError, ValueError) as error:
            raise ValueError(f"these bytes are no object model: {error}") from error

    def _registered(
        self,
        frame: Frame,
        oriented: NDArray[np.float64],
        features: ViewFeatures | None,
        given: NDArray[np.float64] | None,
    ) -> Registration | None:
        model = self.pose_model()
        if given is not None:
            return _refined(model, frame, oriented, given, "given")
        for stored, pose in reversed(self.views if features is not None else ()):
            assert features is not None
            movement = match_views(stored, features).first_from_second
            if movement is not None:
                found = _refined(model, frame, oriented, pose @ movement, "keypoints")
                if found is not None:
                    return found
        labels = (frame.object_mask() & (frame.depth_m > 0)).astype(np.int32)
        estimate = estimate_pose(model, frame, labels, 1, PoseParams(merge=False))
        if estimate is None or estimate.ambiguous or estimate.fit < _LEAST_FIT:
            return None
        inverse = np.linalg.inv(estimate.camera_from_object).astype(np.float64)
        return _refined(model, frame, oriented, inverse, "shape")


def _oriented(frame: Frame) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return places and normals (n, 6) in the camera's frame, and colours (n, 3)."""
    points = frame.points()
    mask = frame.object_mask() & np.isfinite(points).all(axis=-1)
    places = points[mask]
    rng = np.random.default_rng(0)
    order = np.sort(rng.permutation(len(places))[:_MOST_POINTS])
    chosen = scene_points(places[order], _MOST_POINTS, np.inf, np.random.default_rng(0))
    shuffled = np.random.default_rng(0).permutation(len(order))[:_MOST_POINTS]
    inks = np.full((len(places), 3), 128, np.uint8) if frame.rgb is None else frame.rgb[mask]
    towards = -chosen.places / np.maximum(np.linalg.norm(chosen.places, axis=1), 1e-9)[:, None]
    # Depth at grazing incidence is smeared between the object and what is behind it.
    steady = np.einsum("ni,ni->n", towards, chosen.normals) > _GRAZING
    both = np.hstack([chosen.places, chosen.normals])[steady]
    return both, inks[order][shuffled][steady]


def _refined(
    model: PoseModel,
    frame: Frame,
    oriented: NDArray[np.float64],
    object_from_camera: NDArray[np.float64],
    how: str,
) -> Registration | None:
    """Improve a movement, and refuse it when it drifts off or view and model contradict."""
    camera_from_object = np.linalg.inv(object_from_camera).astype(np.float64)
    rotation = camera_from_object[:3, :3]
    start = Poses(
        rotation[None].copy(),
        (camera_from_object[:3, 3] + rotation @ model.centre)[None].copy(),
        np.zeros(1),
    )
    points = scene_points(
        oriented[:, :3].astype(np.float32), 2000, np.inf, np.random.default_rng(0)
    )
    found = refine(model, points, start)
    away = distances(
        *(points.places, found.rotations[0], found.translations[0], model.samples),
        *(model.grid, model.corner, model.cell_m),
    )
    overlap = float((away < _OVERLAP_M + model.cell_m / 2).mean())
    drift_m = float(np.linalg.norm(found.translations[0] - start.translations[0]))
    drift_rad = angle_between(start.rotations[0], found.rotations[0])
    if overlap < _LEAST_OVERLAP or drift_m > _MOST_DRIFT_M or drift_rad > _MOST_DRIFT_RAD:
        return None
    violation = _violation(model, frame, found.rotations[0], found.translations[0])
    if violation > _MOST_VIOLATION:
        return None
    pose = model.camera_from_object(found.rotations[0], found.translations[0])
    return Registration(np.linalg.inv(pose).astype(np.float64), how, overlap, violation)


def _smoothed(cloud: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the cloud with each point on the mean plane of those around it that face its way.

    Views of a noisy sensor pile up in a layer a few mm thick; its middle is the surface. Points
    round an edge face another way and do not blunt it.
    """
    rows = cloud.astype(np.float64)
    if len(rows) < _AROUND:
        return rows
    away, near = cKDTree(rows[:, :3]).query(rows[:, :3], k=_AROUND)
    alike = np.einsum("nki,ni->nk", rows[near, 3:], rows[:, 3:])
    weight = np.exp(-((away / _SMOOTH_M) ** 2)) * (alike > _ALIKE)
    weight /= weight.sum(axis=1, keepdims=True)
    normals = np.einsum("nk,nki->ni", weight, rows[near, 3:])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    middle = np.einsum("nk,nki->ni", weight, rows[near, :3])
    off = np.einsum("ni,ni->n", middle - rows[:, :3], normals)
    return np.hstack([rows[:, :3] + off[:, None] * normals, normals])


def _violation(
    model: PoseModel,
    frame: Frame,
    rotation: NDArray[np.float64],
    translation: NDArray[np.float64],
) -> float:
    """Return the share of the model's visible side that a view contradicts at a pose.

    Of a shell seen from behind only a ragged rim shows, which says little: the share is one of a
    quarter of the surface at least.
    """
    lens = frame.intrinsics
    sight = check_free_space(
        *(model.samples, rotation[None], translation[None]),
        np.where(np.isfinite(frame.depth_m), frame.depth_m, 0).astype(np.float32),
        frame.object_mask() & (frame.depth_m > 0),
        (lens.fx, lens.fy, lens.cx - frame.x0, lens.cy - frame.y0),
        model.spacing_m,
    )
    judged = max(float(sight.agreeing[0] + sight.violating[0]), _LEAST_JUDGED * len(model.samples))
    return float(sight.violating[0]) / judged


def _merged(
    model: ObjectModel, moved: NDArray[np.float32], colours: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    """Average what lies in one voxel and faces one way; voxels grow until there are few enough."""
    merged = _averaged(model, moved, colours, _VOXEL_M)
    edge_m = _VOXEL_M
    while len(merged[0]) > _MOST_KEPT:
        edge_m *= 1.5
        merged = _averaged(model, moved, colours, edge_m)
    return merged


def _averaged(
    model: ObjectModel, moved: NDArray[np.float32], colours: NDArray[np.uint8], edge_m: float
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]:
    rows = np.vstack([model.cloud, moved]).astype(np.float64)
    inks = np.vstack([model.colours, colours]).astype(np.float64)
    weights = np.concatenate([model.weights, np.ones(len(moved), np.float32)]).astype(np.float64)
    side = np.abs(rows[:, 3:]).argmax(axis=1)
    sign = np.take_along_axis(rows[:, 3:], side[:, None], axis=1)[:, 0] > 0
    keys = np.floor(rows[:, :3] / edge_m).astype(np.int64)
    keys = np.column_stack([keys, 2 * side + sign])
    _, number = np.unique(keys, axis=0, return_inverse=True)
    number = number.ravel()
    total = np.bincount(number, weights)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = [np.bincount(number, weights * column) / total for column in values.T]
        return np.stack(columns, axis=1)

    cloud = mean(rows)
    cloud[:, 3:] /= np.maximum(np.linalg.norm(cloud[:, 3:], axis=1, keepdims=True), 1e-9)
    return cloud.astype(np.float32), np.rint(mean(inks)).astype(np.uint8), total.astype(np.float32)


def warm_up() -> None:
    """Compile the kernels of growing and of poses; they stay on disk for the next process."""
    camera = Intrinsics.from_fov(96, 72, 0.9)
    v, u = np.mgrid[:72, :96]
    ridge = (0.4 - 0.02 * np.exp(-(((u - 44) / 14) ** 2) - ((v - 36) / 9) ** 2)).astype(np.float32)
    mask = (abs(u - 48) < 26) & (abs(v - 36) < 18)
    frame = Frame(np.where(mask, ridge, np.float32(0.5)), camera, mask=mask)
    model, _ = ObjectModel().add(frame)
    model, _ = model.add(frame, object_from_camera=np.eye(4))
    estimate_pose(
        model.pose_model(), frame, mask.astype(np.int32), 1, PoseParams(starts=8), None,
        initial=np.eye(4)[None],
    )  # fmt: skip
