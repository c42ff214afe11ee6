"""Models of objects that grow from view to view: one cloud, one mesh, ready for poses."""

from features.modelling.grow import ObjectModel, Registration, warm_up
from features.modelling.reconstruction import Reconstruction, reconstruct
from features.modelling.surface import mesh_to_ply, surface_of

__all__ = [
    "ObjectModel",
    "Reconstruction",
    "Registration",
    "mesh_to_ply",
    "reconstruct",
    "surface_of",
    "warm_up",
]
