"""The object's weight as plans of grasps take it: stated, or assumed from its volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp.arrays import FloatArray
from grasp.spatial.candidate import Proposals
from grasp.spatial.collision import Support
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.scoring.holding import assumed_mass

__all__ = ["ObjectLoad", "load_to_plan_for"]


@dataclass(frozen=True, eq=False)
class ObjectLoad:
    """The mass of an object and the direction of its weight.

    Parameters
    ----------
    mass
        kg.
    up : (3,)
        Unit vector against gravity in the object's frame.
    is_assumed
        Whether the mass is a guess: then it orders grasps and refuses none.
    """

    mass: float
    up: FloatArray
    is_assumed: bool

    @classmethod
    def of(cls, mesh: Mesh, mass: float | None, support: Support | None) -> ObjectLoad:
        """Return the load of an object that stands on a support, or floats with z up.

        Parameters
        ----------
        mass
            kg; None = assumed to be that of wood.

        Examples
        --------
        >>> from grasp.spatial.meshes.shapes import box_mesh
        >>> ObjectLoad.of(box_mesh((0.1, 0.06, 0.04)), None, None).notes
        ('ordered for an assumed mass of 0.17 kg',)
        """
        up = np.array([0.0, 0.0, 1.0]) if support is None else support.up
        return cls(assumed_mass(mesh) if mass is None else mass, up, mass is None)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of a plan: that the mass is assumed."""
        if not self.is_assumed:
            return ()
        return (f"ordered for an assumed mass of {self.mass:.2g} kg",)


def load_to_plan_for(
    mesh: Mesh, mass: float | None, support: Support | None
) -> ObjectLoad | Proposals:
    """Return the load of an object, or proposals that say why nothing can be planned on it.

    Parameters
    ----------
    mesh, mass, support
        As of :meth:`ObjectLoad.of`; the mesh may have no face.
    """
    if len(mesh.faces) == 0:
        return Proposals(reason="the mesh has no face", notes=mesh.notes)
    return ObjectLoad.of(mesh, mass, support)
