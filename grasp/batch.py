"""Grasps in space of many objects, each planned by itself and so in any place (Kehoe 2014, 3.8)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from grasp.spatial.candidate import Proposals
from grasp.spatial.collision import Support, Surroundings
from grasp.spatial.contact_plan import OtherHand, plan_contacts
from grasp.spatial.grasp_plan import SpatialOptions, plan_on_mesh
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh_files import mesh_from_bytes

__all__ = ["BatchPlan", "MeshFile", "Planned"]


@dataclass(frozen=True)
class MeshFile:
    """A mesh as its file holds it, so that every machine reads the same.

    ``kind`` is the ending of its name without the dot.
    """

    name: str
    kind: str
    contents: bytes

    @classmethod
    def read(cls, path: Path) -> MeshFile:
        """Return the contents of a file."""
        return cls(str(path), path.suffix.lower().lstrip("."), path.read_bytes())


@dataclass(frozen=True)
class Planned:
    """Result for one object: its grasps, or why its mesh could not be read."""

    name: str
    proposals: Proposals
    error: str = ""


@dataclass(frozen=True)
class BatchPlan:
    """Task of an executor, called with a range of the meshes.

    Parameters
    ----------
    meshes
        What to plan on; z up where they stand on a support.
    gripper
        Of all plans: jaws, a suction cup or three fingers.
    options
        The same for each; ``reachable`` is for one process only.
    scale
        Metres per unit of the files.
    floating
        Without a support below the lowest vertex.

    Raises
    ------
    ValueError
        The scale suits no mesh.
    """

    meshes: tuple[MeshFile, ...]
    gripper: ParallelGripper | OtherHand
    options: SpatialOptions
    scale: float = 1.0
    floating: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.scale < math.inf:
            raise ValueError(f"scale: expected a finite number above 0, got {self.scale}")

    def __call__(self, first: int, count: int) -> list[Planned]:
        """Return the plans of ``count`` meshes from number ``first`` on."""
        return [self.plan(mesh) for mesh in self.meshes[first : first + count]]

    def plan(self, file: MeshFile) -> Planned:
        """Plan grasps of one mesh; a mesh that cannot be used is no error of the others."""
        try:
            mesh = mesh_from_bytes(file.contents, file.kind, file.name, self.scale)
            lowest = float(mesh.vertices[:, 2].min()) if len(mesh.vertices) else 0.0
            around = Surroundings(None if self.floating else Support(lowest))
            if isinstance(self.gripper, ParallelGripper):
                proposals = plan_on_mesh(mesh, self.gripper, around, self.options)
            else:
                proposals = plan_contacts(mesh, self.gripper, around, self.options)
            return Planned(file.name, proposals)
        except ValueError as error:
            return Planned(file.name, Proposals(reason="the mesh cannot be used"), str(error))
