"""Surfaces of products, reconstructed from their views on demand."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.engine.operations.operation import operation
from rtask.engine.perception.meshes import reconstruct_object
from rtask.engine.records.objects import resolve_object
from rtask.rdf.terms import iri
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Text
from rtask.world.surfaces import stored_mesh

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["ReconstructMesh", "ReconstructedMesh", "reconstruct_mesh"]


class ReconstructMesh(Message):
    """A request for the surface of a known object."""

    object: Text
    """IRI, objectId or name of the object"""
    again: Flag = False
    """reconstruct it even if there is one that was made from the present model"""


class ReconstructedMesh(Answer):
    """A closed surface, how well it fits, and how much of it was seen.

    ``commit`` is empty if it was there already. The bytes ``blob`` are a PLY file, m, in the
    object's frame, whose vertices say by ``seen`` whether they were measured or filled in.
    """

    object: str
    mesh: str
    blob: str
    views: int
    seen_share: float
    median_residual: float
    residual_90: float
    watertight: bool
    commit: str


@operation("write", "writes", "reconstruct the surface of a known object from its views")
def reconstruct_mesh(
    context: Context, request: ReconstructMesh, access: Access
) -> ReconstructedMesh:
    """Return the surface of an object, reconstructed unless a current one is stored."""
    object_iri = iri(resolve_object(context, request.object))
    mesh, commit = stored_mesh(context.kb, object_iri), ""
    if mesh is None or not mesh.is_current or request.again:
        mesh, commit = reconstruct_object(context, object_iri, access)
    return ReconstructedMesh(
        object=object_iri.value,
        mesh=mesh.iri,
        blob=mesh.blob,
        views=mesh.views,
        seen_share=mesh.seen_share,
        median_residual=mesh.median_residual_m,
        residual_90=mesh.residual_90_m,
        watertight=mesh.is_watertight,
        commit=commit,
    )
