"""One cloud of an object, grown from registered views (Kehoe 2014, 4.3: models from scans).

The first view gives the object's frame. A later view joins when its movement is known, or follows
from matched keypoints or from its shape, and when its points then lie on what is known already:
a view that does not fit is refused rather than smeared over the model. As long as the views are
few, each that joins may move all others but the first.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame, Intrinsics
from features.modelling.fusion import fused, smoothed
from features.modelling.registration import Registration, Surface, registered
from features.modelling.scans import Scan, fused_scans, scans_from_arrays, scans_to_arrays
from features.modelling.settling import settled
from features.modelling.surface import surface_of
from features.pose.estimate import PoseParams, estimate_pose
from features.pose.model import PoseModel, build_pose_model
from features.pose.rotations import rotation_about
from features.recognition.pairs import match_views
from features.recognition.views.view import ViewFeatures

__all__ = ["ObjectModel", "Registration", "warm_up"]

_MIN_FIT = 0.45
_MODEL_GRID, _MODEL_POINTS = 48, 6000
_NOISE_M = 0.0005
_MAX_CELLS = 160
_MIN_SETTLED, _MAX_SETTLED = 3, 12
_MAX_SWEPT, _COPIES = 600, 24


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """Model of an object's surface. Immutable: adding a view returns a new model.

    Parameters
    ----------
    cloud : (n, 6) float32
        Places (m, object frame) and outward normals, at most one in 1.5 mm, and at most 40,000:
        what is larger is kept more coarsely.
    colours : (n, 3) uint8 RGB
    weights : (n,) float32
        Trust in each point: the measurements behind it, near and straight ones counting more.
    views : tuple of (ViewFeatures, int)
        Described ones, each with its number in ``sources``: later views are matched with them.
    sources : tuple of (name, object_from_camera (4, 4))
        Every view that is in it, in the order in which they came.
    scans : tuple of Scan
        What each of them showed, up to 12 views: beyond, the movements are settled, and there is
        none.

    Examples
    --------
    >>> ObjectModel().is_empty
    True
    """

    cloud: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 6), np.float32))
    colours: NDArray[np.uint8] = field(default_factory=lambda: np.empty((0, 3), np.uint8))
    weights: NDArray[np.float32] = field(default_factory=lambda: np.empty(0, np.float32))
    views: tuple[tuple[ViewFeatures, int], ...] = ()
    sources: tuple[tuple[str, NDArray[np.float64]], ...] = ()
    scans: tuple[Scan, ...] = ()

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
        is_measured: bool = False,
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
        is_measured
            The movement was measured within about 1.5 degrees and 3 mm, as on a turntable: the
            view may show a side of which nothing is known.

        Returns
        -------
        ObjectModel
            The same one when the view was refused.
        Registration or None
            None when it was refused.
        """
        scan = Scan.of(frame)
        if len(scan) < 30:
            return self, None
        if self.is_empty:
            pose = np.eye(4) if object_from_camera is None else object_from_camera
            registration: Registration | None = Registration(pose, "first", 1.0)
        else:
            registration = self._registered(frame, scan, features, object_from_camera, is_measured)
        if registration is None:
            return self, None
        poses = [pose for _, pose in self.sources] + [registration.object_from_camera]
        names = [name for name, _ in self.sources] + [name]
        views = self.views if features is None else (*self.views, (features, len(self.sources)))
        # Settling compares all scans with each other, so its time grows with the square of their
        # number; later views are only added to the surface.
        if len(self.scans) < len(self.sources) or len(poses) > _MAX_SETTLED:
            cloud = fused(
                np.vstack([self.cloud, scan.moved(registration.object_from_camera)]),
                np.vstack([self.colours, scan.colours]),
                np.concatenate([self.weights, scan.trust]),
            )
            return ObjectModel(*cloud, views, tuple(zip(names, poses, strict=True))), registration
        prior_pose = (
            registration.object_from_camera if object_from_camera is None else object_from_camera
        )
        pivot = prior_pose[:3, 3] if is_measured or self.is_empty else self._surface.centre
        scans = (
            *self.scans,
            replace(scan, prior_pose=prior_pose, pivot=pivot, is_measured=is_measured),
        )
        if len(scans) >= _MIN_SETTLED:
            poses = settled(scans, poses)
            registration = replace(registration, object_from_camera=poses[-1])
        sources = tuple(zip(names, poses, strict=True))
        return ObjectModel(*fused_scans(scans, poses), views, sources, scans), registration

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
    def _surface(self) -> Surface:
        return Surface(self.cloud, self.weights)

    @cached_property
    def _pose_model(self) -> PoseModel:
        cloud = smoothed(self.cloud, self.weights, _MODEL_POINTS)
        return build_pose_model(
            cloud[:, :3], normals=cloud[:, 3:], grid=_MODEL_GRID, noise_m=_NOISE_M,
            colours=(self.cloud[:, :3], self.colours),
        )  # fmt: skip

    @cached_property
    def _round_pose_model(self) -> PoseModel:
        return self.revolved()._pose_model

    def revolved(self) -> ObjectModel:
        """Return the body that a round object's surface sweeps about the z axis of its frame."""
        # Fixed, so that the same views give the same model on each machine.
        rng = np.random.default_rng(0)
        rows = np.sort(rng.permutation(len(self.cloud))[:_MAX_SWEPT])
        axis = np.array([0.0, 0.0, 1.0])
        turns = np.stack([rotation_about(axis, 2 * np.pi * k / _COPIES) for k in range(_COPIES)])
        swept = [
            np.einsum("kij,nj->kni", turns, self.cloud[rows, part].astype(np.float64))
            for part in (slice(0, 3), slice(3, 6))
        ]
        cloud = np.concatenate(swept, axis=2).reshape(-1, 6).astype(np.float32)
        return ObjectModel(
            cloud, np.tile(self.colours[rows], (_COPIES, 1)), np.tile(self.weights[rows], _COPIES)
        )

    def mesh(
        self, cell_m: float = 0.003
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
        """Return vertices (v, 3) m, faces (f, 3), colours (v, 3); open where nothing was seen."""
        size = np.ptp(self.cloud[:, :3], axis=0).max() if len(self.cloud) else 0.0
        return surface_of(self.cloud, self.colours, max(cell_m, float(size) / _MAX_CELLS))

    def to_bytes(self) -> bytes:
        """Return an ``.npz`` of all but the described views, which are kept by whoever has them.

        The cloud is left out where the scans make it again: it would be half of the file.
        """
        buffer = io.BytesIO()
        arrays: dict[str, Any] = {
            "names": np.array([name for name, _ in self.sources], np.str_),
            "poses": np.array([pose for _, pose in self.sources], "<f8").reshape(-1, 4, 4),
        }
        # With the scans at hand the surface is computed from them again, and need not be stored.
        if not self.scans:
            arrays |= {
                "cloud": self.cloud.astype("<f4"),
                "colours": self.colours,
                "weights": self.weights.astype("<f4"),
            }
        np.savez_compressed(buffer, **arrays, **scans_to_arrays(self.scans))
        return buffer.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> ObjectModel:
        """Read what :meth:`to_bytes` wrote."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                poses = arrays["poses"].astype(np.float64).reshape(-1, 4, 4)
                sources = tuple(zip(arrays["names"].tolist(), poses, strict=True))
                scans = scans_from_arrays(arrays)
                if "cloud" not in arrays:
                    return cls(*fused_scans(scans, poses), sources=sources, scans=scans)
                cloud = arrays["cloud"].astype(np.float32).reshape(-1, 6)
                return cls(
                    cloud,
                    arrays["colours"].astype(np.uint8).reshape(len(cloud), 3),
                    arrays["weights"].astype(np.float32).reshape(len(cloud)),
                    sources=sources,
                    scans=scans,
                )
        except (zipfile.BadZipFile, KeyError, OSError, EOFError, ValueError) as error:
            raise ValueError(f"these bytes are no object model: {error}") from error

    def _registered(
        self,
        frame: Frame,
        scan: Scan,
        features: ViewFeatures | None,
        given: NDArray[np.float64] | None,
        is_measured: bool,
    ) -> Registration | None:
        oriented = scan.rows.astype(np.float64)
        if given is not None:
            return registered(self._surface, frame, oriented, given, "given", is_measured)
        # Newest first: the last view was most likely taken from nearby.
        for stored, number in reversed(self.views if features is not None else ()):
            assert features is not None
            movement = match_views(stored, features).first_from_second
            if movement is not None:
                prior_pose = self.sources[number][1] @ movement
                registration = registered(self._surface, frame, oriented, prior_pose, "keypoints")
                if registration is not None:
                    return registration
        labels = (frame.object_mask() & (frame.depth_m > 0)).astype(np.int32)
        estimate = estimate_pose(self.pose_model(), frame, labels, 1, PoseParams(merge=False))
        # A view put on the wrong side of the model spoils it for good; one that is left out can be
        # taken again.
        if estimate is None or estimate.ambiguous or estimate.fit < _MIN_FIT:
            return None
        inverse = np.linalg.inv(estimate.camera_from_object).astype(np.float64)
        return registered(self._surface, frame, oriented, inverse, "shape")


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
