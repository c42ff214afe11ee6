"""Kehoe's turntable (Kehoe 2014, 4.6), rendered: 148 views of each textured object.

Azimuth every 5 degrees at two low elevations and four views from above; the camera stands 3.6
bounding radii away, so that the size in the image says nothing. White background, sensor noise of
2 of 255, JPEG of quality 90; depth with a noise of 0.4 % of the distance, as a structured-light
camera has at 0.8 m.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import Intrinsics
from features.recognition.views.view import EXTRACTOR, ViewFeatures, describe_view

SIDE_PX = 384
"""The middle of a 640 x 480 image with a vertical field of view of 45 degrees."""
FOCAL_PX = 240 / np.tan(np.deg2rad(22.5))
CAMERA = Intrinsics(SIDE_PX, SIDE_PX, FOCAL_PX, FOCAL_PX, (SIDE_PX - 1) / 2, (SIDE_PX - 1) / 2)
DISTANCE_RADII = 3.6
DEPTH_NOISE = 0.004


@dataclass(frozen=True, eq=False)
class Picture:
    """One view as a camera sends it: JPEG, mask, depth in m."""

    jpeg: bytes
    mask: NDArray[np.bool_]
    depth_m: NDArray[np.float32]

    def rgb(self) -> NDArray[np.uint8]:
        """Return the image (h, w, 3)."""
        image = cv2.imdecode(np.frombuffer(self.jpeg, np.uint8), cv2.IMREAD_COLOR)
        return np.ascontiguousarray(np.asarray(image, np.uint8)[..., ::-1])

    def describe(self) -> ViewFeatures:
        """Describe it with depth; :func:`without_depth` takes that away again."""
        return describe_view(self.rgb(), self.mask, self.depth_m, CAMERA)


def ycb_folder() -> Path | None:
    """Return the folder of the models, or None."""
    folder = Path(os.environ.get("RTASK_SHARED_DATA", "shared/data")) / "ycb"
    return folder if folder.is_dir() else None


def ycb_names(folder: Path) -> list[str]:
    """Return the names of all objects."""
    return sorted(path.stem for path in folder.glob("*.urdf"))


def is_fitted(name: str) -> bool:
    """Tell whether an object's views were used to fit the constants of the confidence.

    Families stay together, so that no unknown object of the others has a sibling among these.
    """
    families = ("toy_airplane", "lego_duplo", "clamp", "screwdriver", "marbles")
    return any(family in name for family in families) or name in _FITTED


_FITTED = frozenset(
    [
        "apple",
        "banana",
        "bleach_cleanser",
        "chain",
        "cracker_box",
        "dice",
        "foam_brick",
        "gelatin_box",
        "hammer",
        "lemon",
        "master_chef_can",
        "mustard_bottle",
        "orange",
        "padlock",
        "peach",
        "pear",
        "plum",
        "power_drill",
        "pudding_box",
        "strawberry",
    ]
)


LOW = (0.25, 0.6)
"""Elevations of the views from the side, rad."""


def viewpoints(
    step_deg: int, first_deg: float = 0.0, elevations: tuple[float, ...] = LOW
) -> list[tuple[float, float]]:
    """Return azimuth and elevation, rad."""
    low = [(np.deg2rad(a + first_deg), e) for e in elevations for a in range(0, 360, step_deg)]
    return [*low, *((np.deg2rad(a + first_deg), 1.5) for a in range(0, 360, 90))]


def render_views(
    folder: Path,
    name: str,
    step_deg: int,
    seed: int,
    first_deg: float = 0.0,
    elevations: tuple[float, ...] = LOW,
) -> Iterator[Picture]:
    """Render every view of one object."""
    from simulate.world.world import World

    rng = np.random.default_rng([seed, *name.encode()])
    with World() as world:
        client = world.client
        client.setAdditionalSearchPath(str(folder))
        body = client.loadURDF(f"{name}.urdf")
        low, high = (np.array(corner) for corner in client.getAABB(body))
        centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        near, far = (DISTANCE_RADII - 2) * radius, (DISTANCE_RADII + 2) * radius
        fov = float(np.rad2deg(2 * np.arctan(SIDE_PX / 2 / FOCAL_PX)))
        projection = client.computeProjectionMatrixFOV(fov, 1, near, far)
        for azimuth, elevation in viewpoints(step_deg, first_deg, elevations):
            towards = np.array(
                [
                    np.cos(azimuth) * np.cos(elevation),
                    np.sin(azimuth) * np.cos(elevation),
                    np.sin(elevation),
                ]
            )
            eye = centre + DISTANCE_RADII * radius * towards
            look = client.computeViewMatrix(eye.tolist(), centre.tolist(), [0, 0, 1])
            _, _, rgba, buffer, bodies = client.getCameraImage(
                *(SIDE_PX, SIDE_PX, look, projection),
                shadow=0,
                lightAmbientCoeff=0.55,
                lightDiffuseCoeff=0.5,
                lightSpecularCoeff=0.05,
                renderer=client.ER_TINY_RENDERER,
            )
            mask = np.asarray(bodies).reshape(SIDE_PX, SIDE_PX) == body
            if not mask.any():
                continue
            image = np.asarray(rgba, np.uint8).reshape(SIDE_PX, SIDE_PX, 4)[..., :3]
            shown = np.where(mask[..., None], image, 245).astype(np.float64)
            noisy = np.clip(shown + rng.normal(0, 2, shown.shape), 0, 255).astype(np.uint8)
            jpeg = cv2.imencode(".jpg", noisy[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
            share = np.asarray(buffer, np.float64).reshape(SIDE_PX, SIDE_PX)
            depth = far * near / (far - (far - near) * share)
            depth *= 1 + rng.normal(0, DEPTH_NOISE, depth.shape)
            yield Picture(jpeg.tobytes(), mask, np.where(mask, depth, 0).astype(np.float32))


def described_views(
    folder: Path, name: str, step_deg: int, seed: int, cache: Path | None
) -> list[ViewFeatures]:
    """Return the features of every view, from the cache where they were made before."""
    if cache is None:
        return [picture.describe() for picture in render_views(folder, name, step_deg, seed)]
    known = cache / f"{name}-{step_deg}-{seed}-{EXTRACTOR.replace('/', '_')}.pickle"
    if not known.is_file():
        cache.mkdir(parents=True, exist_ok=True)
        views = described_views(folder, name, step_deg, seed, None)
        known.write_bytes(pickle.dumps([view.to_bytes() for view in views]))
    return [ViewFeatures.from_bytes(data) for data in pickle.loads(known.read_bytes())]


def without_depth(view: ViewFeatures) -> ViewFeatures:
    """Return the same view as a colour camera alone sees it."""
    from dataclasses import replace

    return replace(
        view, points3d=np.full_like(view.points3d, np.nan), size_m=float("nan"),
        surface=None, shape=None,
    )  # fmt: skip
