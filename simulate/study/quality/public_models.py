"""Objects made by others: models of the YCB set, and the random ones that pybullet brings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.bodies import enclosed_volume
from rtask.errors import UsageError
from simulate.robots.description import Floats
from simulate.study.quality.objects import GraspObject, centred, fits
from simulate.world.seeds import stream

__all__ = ["public_model", "ycb_models"]

_ORDER = 61
_DENSITY = 700.0
_SMALLEST_M = 1e-4


def ycb_models(folder: Path) -> list[GraspObject]:
    """Return the models of a folder of YCB objects, in the order of their names.

    Parameters
    ----------
    folder
        Has for each NAME ``NAME.urdf`` with the mass and ``NAME/*coacd*.stl``, its convex parts.

    Raises
    ------
    UsageError
        When there is none.
    """
    import trimesh

    models = []
    for urdf in sorted(folder.glob("*.urdf")):
        paths = sorted((folder / urdf.stem).glob("*coacd*.stl"))
        parts = _solid([np.asarray(trimesh.load_mesh(path).vertices) for path in paths])
        mass = re.search(r'mass value="([\d.e+-]+)"', urdf.read_text("utf-8"))
        if parts and mass is not None and float(mass.group(1)) > 0:
            models.append(centred(urdf.stem, parts, float(mass.group(1))))
    if not models:
        raise UsageError(f"{folder} holds no NAME.urdf with parts NAME/*coacd*.stl")
    return models


def public_model(folder: Path, seed: int, number: int, gripper: ParallelGripper) -> GraspObject:
    """Return a model of a folder that a hand can hold, another for every number.

    Parameters
    ----------
    folder
        Has ``NAME/NAME.urdf`` and ``NAME/NAME.obj`` with an object of the file for each convex
        part, as pybullet's ``random_urdfs``. All state the same mass, so each weighs what wood of
        its volume does (700 kg/m3).
    seed
        Gives the order.

    Raises
    ------
    UsageError
        When fewer of them fit.
    """
    fitting = _fitting(folder, seed, gripper)
    while len(fitting.models) <= number and fitting.left:
        model = _read_model(folder / fitting.left.pop())
        if model is not None and fits(model, gripper):
            fitting.models.append(model)
    if len(fitting.models) <= number:
        raise UsageError(f"{folder} has {len(fitting.models)} models that {gripper.name} can hold")
    return fitting.models[number]


@dataclass
class _Fitting:
    """Models that fit a hand so far, and the names of those that were not looked at."""

    left: list[str]
    models: list[GraspObject] = field(default_factory=list)


@lru_cache(maxsize=4)
def _fitting(folder: Path, seed: int, gripper: ParallelGripper) -> _Fitting:
    names = sorted(p.parent.name for p in folder.glob("*/*.urdf") if p.stem == p.parent.name)
    if not names:
        raise UsageError(f"{folder} holds no NAME/NAME.urdf")
    order = stream(seed, _ORDER).permutation(len(names))
    return _Fitting([names[k] for k in order])


def _read_model(folder: Path) -> GraspObject | None:
    """Return the model of a folder; None if no part of it has a volume."""
    scale = re.search(r'scale="([^"]+)"', (folder / f"{folder.name}.urdf").read_text("utf-8"))
    factors = np.array([float(v) for v in scale.group(1).split()]) if scale else np.ones(3)
    corners: list[list[list[float]]] = [[]]
    for line in (folder / f"{folder.name}.obj").read_text("utf-8").splitlines():
        kind, *values = line.split() or [""]
        if kind in ("o", "g"):
            corners.append([])
        elif kind == "v":
            corners[-1].append([float(v) for v in values[:3]])
    parts = _solid([np.reshape(part, (-1, 3)) * factors for part in corners])
    if not parts:
        return None
    model = centred(folder.name, parts, 1.0)
    # Unlike what a planner assumes, nothing is added to what is light: 20 g are 20 g here.
    return replace(model, mass=_DENSITY * enclosed_volume(model.mesh()))


def _solid(parts: Sequence[NDArray[np.floating[Any]]]) -> list[Floats]:
    """Return the corners (n, 3), m, of the hulls of those parts that have a volume."""
    return [
        np.asarray(part[ConvexHull(part).vertices], dtype=np.float64)
        for part in parts
        if len(part) >= 4 and np.ptp(part, axis=0).min() > _SMALLEST_M
    ]
