"""Folders of BOP datasets: scenes, cameras, true poses, models, targets, and files of results.

Layout: ``<dataset>/<split>/000001/{scene_camera,scene_gt,scene_gt_info}.json``, ``depth/`` and
``rgb/`` or ``gray/``, ``mask_visib/``; ``<dataset>/models/obj_000001.ply`` with
``models_info.json``. Lengths on disk are mm, here they are m. Numbers in names may have fewer
digits than six: writers with habits of SIXD, which the format grew out of, give images four.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from features.geometry import Float64Array, Frame, Intrinsics

__all__ = ["BopDataset", "BopEstimate", "BopModel", "BopObject", "BopView", "write_results"]

_MM = 0.001
_TURNS = 72


@dataclass(frozen=True, eq=False)
class BopObject:
    """One object in a view.

    Parameters
    ----------
    camera_from_object : (4, 4) float64, m
    visible
        Share of its pixels that nothing hides; None where the dataset does not say.
    mask : (h, w) bool or None
        Of its visible pixels.
    """

    object_id: int
    camera_from_object: Float64Array
    visible: float | None = None
    mask: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class BopView:
    """One image with its true poses."""

    scene_id: int
    image_id: int
    frame: Frame
    objects: tuple[BopObject, ...]


@dataclass(frozen=True, eq=False)
class BopModel:
    """The mesh of an object.

    Parameters
    ----------
    vertices : (v, 3) float64, m
    faces : (f, 3) int64
    diameter_m
        Largest distance of two vertices, as the dataset says.
    symmetries : (s, 4, 4) float64, m
        The identity first; continuous ones in 72 steps.
    """

    vertices: Float64Array
    faces: NDArray[np.int64]
    diameter_m: float
    symmetries: Float64Array


@dataclass(frozen=True, eq=False)
class BopEstimate:
    """One line of a file of results."""

    scene_id: int
    image_id: int
    object_id: int
    score: float
    camera_from_object: Float64Array
    seconds: float = -1.0


class BopDataset:
    """A dataset on disk.

    Parameters
    ----------
    folder
        With ``models/`` and the splits.

    Raises
    ------
    FileNotFoundError
        When there is no such folder.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise FileNotFoundError(f"no BOP dataset: {self.folder} is no folder")
        self._info: dict[str, Any] | None = None

    def scenes(self, split: str = "test") -> list[int]:
        """Return the numbers of the scenes of a split.

        Raises
        ------
        ValueError
            When there is no such split, with those that there are.
        """
        folder = self.folder / split
        if not folder.is_dir():
            parts = sorted(entry.name for entry in self.folder.iterdir() if entry.is_dir())
            raise ValueError(f"{folder}: no such split; {self.folder} has {', '.join(parts)}")
        return sorted(
            int(entry.name)
            for entry in folder.iterdir()
            if entry.name.isdigit() and (entry / "scene_camera.json").is_file()
        )

    def targets(self, name: str = "test_targets_bop19.json") -> list[tuple[int, int, int, int]]:
        """Return (scene, image, object, number of instances) of what is to be estimated."""
        path = self.folder / name
        keys = ("scene_id", "im_id", "obj_id", "inst_count")
        return [
            (numbers[0], numbers[1], numbers[2], numbers[3])
            for numbers in (
                [int(_numbers(path, target, key)) for key in keys] for target in _read_json(path)
            )
        ]

    def views(
        self, scene: int, split: str = "test", images: Iterable[int] | None = None
    ) -> Iterator[BopView]:
        """Yield the views of a scene, in order.

        Parameters
        ----------
        images
            Only these; None = all.

        Raises
        ------
        ValueError
            When a file is damaged or an entry missing, with its path.
        """
        folder = _numbered(self.folder / split, scene)
        cameras = _read_json(folder / "scene_camera.json")
        true = _read_json(folder / "scene_gt.json", {})
        info = _read_json(folder / "scene_gt_info.json", {})
        requested = None if images is None else set(images)
        for number in sorted(map(int, cameras)):
            if requested is not None and number not in requested:
                continue
            key = str(number)
            frame = _frame(folder, number, cameras[key])
            yield BopView(
                scene, number, frame,
                tuple(_objects(folder, number, true.get(key, []), info.get(key, []))),
            )  # fmt: skip

    def model(self, object_id: int, kind: str = "models") -> BopModel:
        """Return the mesh of an object with its symmetries.

        Raises
        ------
        ValueError
            When the mesh does not read, or ``models_info.json`` does not name the object.
        """
        import trimesh

        folder = self.folder / kind
        if self._info is None:
            self._info = _read_json(folder / "models_info.json")
        info = self._info.get(str(object_id))
        if info is None:
            raise ValueError(f"{folder / 'models_info.json'}: no object {object_id}")
        path = folder / f"obj_{object_id:06d}.ply"
        if not path.is_file():
            raise ValueError(f"{path}: no such mesh")
        mesh = trimesh.load(path, process=False, force="mesh")
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            raise ValueError(f"{path}: not a mesh")
        return BopModel(
            np.asarray(mesh.vertices, np.float64) * _MM,
            np.asarray(mesh.faces, np.int64),
            float(_numbers(folder / "models_info.json", info, "diameter")) * _MM,
            _symmetries(info),
        )


def _numbered(folder: Path, number: int, suffix: str = "") -> Path:
    """Return the entry of a folder that has a number, of however many digits; of six if none."""
    usual = folder / f"{number:06d}{suffix}"
    # Six digits are the format's, and win where both are there; SIXD had four, and two of scenes.
    names = (folder / f"{number:0{digits}d}{suffix}" for digits in (6, 4, 5, 3, 2, 1))
    return next((path for path in names if path.exists()), usual)


def _read_json(path: Path, default: Any = None) -> Any:
    if default is not None and not path.is_file():
        return default
    try:
        return json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _numbers(path: Path, entry: Any, key: str, *shape: int) -> Float64Array:
    """Return the numbers of an entry of a file in the shape that its format has."""
    if not isinstance(entry, dict) or key not in entry:
        raise ValueError(f"{path}: an entry lacks {key}")
    try:
        return np.asarray(entry[key], np.float64).reshape(shape)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {key} is {entry[key]!r:.60}; {error}") from None


def _frame(folder: Path, number: int, camera: dict[str, Any]) -> Frame:
    path, told = _numbered(folder / "depth", number, ".png"), folder / "scene_camera.json"
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.is_file() else None
    if depth is None or depth.ndim != 2 or depth.dtype != np.uint16:
        raise ValueError(f"{path}: no depth image of 16 bits")
    k = _numbers(told, camera, "cam_K", 3, 3)
    height, width = depth.shape[:2]
    try:
        lens = Intrinsics(width, height, *(float(k[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))))
    except ValueError as error:
        raise ValueError(f"{told}: image {number}: {error}") from None
    depth_m = np.asarray(depth, np.float32)
    depth_m *= np.float32(float(_numbers(told, camera, "depth_scale")) * _MM)
    colour = _colour(folder, number)
    if colour is not None and colour.shape[:2] != depth.shape:
        raise ValueError(f"{path}: {depth.shape} pixels, its colour image {colour.shape[:2]}")
    return Frame(depth_m, lens, colour)


def _colour(folder: Path, number: int) -> NDArray[np.uint8] | None:
    for kind in ("rgb", "gray"):
        for suffix in ("png", "jpg", "tif"):
            path = _numbered(folder / kind, number, f".{suffix}")
            image = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
            if image is not None:
                return np.ascontiguousarray(image[..., ::-1], dtype=np.uint8)
    return None


def _objects(
    folder: Path, number: int, true: list[dict[str, Any]], info: list[dict[str, Any]]
) -> Iterator[BopObject]:
    told = folder / "scene_gt.json"
    for k, entry in enumerate(true):
        pose = np.eye(4)
        pose[:3, :3] = _numbers(told, entry, "cam_R_m2c", 3, 3)
        pose[:3, 3] = _numbers(told, entry, "cam_t_m2c", 3) * _MM
        path = folder / "mask_visib" / f"{number:06d}_{k:06d}.png"
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
        visible = float(info[k]["visib_fract"]) if k < len(info) else None
        mask = None if image is None else np.asarray(image > 0)
        yield BopObject(int(_numbers(told, entry, "obj_id")), pose, visible, mask)


def _symmetries(info: dict[str, Any]) -> Float64Array:
    """Return all products of the discrete and the continuous symmetries (s, 4, 4), m."""
    discrete = [np.eye(4)]
    for numbers in info.get("symmetries_discrete", ()):
        turn = np.asarray(numbers, np.float64).reshape(4, 4).copy()
        turn[:3, 3] *= _MM
        discrete.append(turn)
    continuous = [np.eye(4)]
    for symmetry in info.get("symmetries_continuous", ()):
        axis = np.asarray(symmetry["axis"], np.float64)
        offset = np.asarray(symmetry.get("offset", (0, 0, 0)), np.float64) * _MM
        for step in range(1, _TURNS):
            turn = np.eye(4)
            angle = 2 * np.pi * step / _TURNS
            turn[:3, :3] = cv2.Rodrigues(angle * axis / np.linalg.norm(axis))[0]
            turn[:3, 3] = offset - turn[:3, :3] @ offset
            continuous.append(turn)
    return np.stack([a @ b for a in discrete for b in continuous])


def write_results(path: Path, estimates: Iterable[BopEstimate]) -> None:
    """Write estimates as the benchmark's server takes them: one line each, R by rows, t in mm."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["scene_id", "im_id", "obj_id", "score", "R", "t", "time"])
        for result in estimates:
            turn, place = result.camera_from_object[:3, :3], result.camera_from_object[:3, 3] / _MM
            writer.writerow(
                [
                    result.scene_id, result.image_id, result.object_id, f"{result.score:.6f}",
                    " ".join(f"{v:.9g}" for v in turn.ravel()),
                    " ".join(f"{v:.9g}" for v in place), f"{result.seconds:.6f}",
                ]
            )  # fmt: skip
