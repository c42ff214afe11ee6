"""Services of robots: kinematics, planning, self filter, trials of failures; their datasets.

The models of the Nao and the Panda are written when they are first asked for.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from rtask.errors import RobotError
from simulate.robots.description import Link
from simulate.services.failure_trials import FailureTrials
from simulate.services.kinematics import Kinematics
from simulate.services.planning import Trajopt
from simulate.services.self_filter import SelfFilter

__all__ = ["DATASETS", "SERVICES", "FailureTrials", "Kinematics", "SelfFilter", "Trajopt"]

SERVICES = (Kinematics, Trajopt, SelfFilter, FailureTrials)
"""Services that this module offers."""

_JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{x} 0 0"/><axis xyz="{axis}"/>'
    '<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/></joint>'
)
_LINK = (
    '<link name="{name}"><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)


def _robot(name: str) -> Callable[[], Mapping[str, bytes]]:
    """Return the files of one of the robots of :mod:`simulate.robots`."""

    def files() -> Mapping[str, bytes]:
        from simulate.robots import describe, urdf_text

        robot = describe(name)
        meshes: dict[str, bytes] = {}
        links = tuple(_with_meshes_beside(link, meshes) for link in robot.links)
        arms = {arm.name: arm.wrist for arm in robot.arms.values()}
        model = urdf_text(replace(robot, links=links), frames=True)
        return {"model": model.encode(), "arms.json": json.dumps(arms).encode(), **meshes}

    return files


def _with_meshes_beside(link: Link, meshes: dict[str, bytes]) -> Link:
    """Return a link whose meshes are files of the dataset, which are added to ``meshes``.

    They are read where their owner installed them.
    """
    shapes = []
    for shape in link.shapes:
        if shape.kind == "mesh":
            source = Path(shape.path)
            name = f"meshes/{source.name}"
            contents = source.read_bytes()
            if meshes.setdefault(name, contents) != contents:
                raise RobotError(f"two meshes of the robot are called {source.name}")
            shape = replace(shape, path=name)
        shapes.append(shape)
    return replace(link, shapes=tuple(shapes))


def _planar(lengths: tuple[float, ...]) -> Callable[[], Mapping[str, bytes]]:
    """Return the files of an arm that moves in the plane z = 0."""

    def files() -> Mapping[str, bytes]:
        joints, before = [], 0.0
        for number, length in enumerate(lengths):
            joints.append(("revolute", "0 0 1", before, -3.14, 3.14))
            before = length
            if number == len(lengths) - 1:
                joints.append(("fixed", "0 0 1", length, 0.0, 0.0))
        return _chain("planar_arm", joints)

    return files


def _point() -> Mapping[str, bytes]:
    """Return the files of a point that moves in the plane: its joints are x and y."""
    joints = [("prismatic", axis, 0.0, -5.0, 5.0) for axis in ("1 0 0", "0 1 0")]
    return _chain("point", joints)


def _chain(name: str, joints: list[tuple[str, str, float, float, float]]) -> Mapping[str, bytes]:
    links = ["base", *(f"link{k}" for k in range(1, len(joints) + 1))]
    parts = [_LINK.format(name=link) for link in links]
    for k, (kind, axis, x, lower, upper) in enumerate(joints):
        parts.append(
            _JOINT.format(
                name=f"joint{k + 1}", kind=kind, parent=links[k], child=links[k + 1], x=x,
                axis=axis, lower=lower, upper=upper,
            )
        )  # fmt: skip
    model = f'<robot name="{name}">{"".join(parts)}</robot>'
    return {"model": model.encode(), "arms.json": json.dumps({"arm": links[-1]}).encode()}


DATASETS: Mapping[str, Callable[[], Mapping[str, bytes]]] = {
    "robots/NAO": _robot("nao"),
    "robots/PlanarArm": _planar((0.5, 0.4, 0.2)),
    "robots/Point": _point,
    # Its model is another package's, which comes with the extra `simulate`.
    **({"robots/Panda": _robot("panda")} if importlib.util.find_spec("pybullet_data") else {}),
}
"""Files of the models by the names of the datasets."""
