"""Reconstruction of the surfaces of products (Kehoe 2014, 4.3: a mesh for each from its scans)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.engine.triples import Triples
from rtask.errors import DataError
from rtask.rdf.namespaces import PROV, RT
from rtask.rdf.terms import NamedNode, iri
from rtask.world.surfaces import StoredMesh, stored_mesh

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access
    from rtask.kb.core import GraphCore
    from rtask.rdf.terms import Value

    Stated = tuple[NamedNode, NamedNode, Value]

__all__ = ["reconstruct_object"]

_PLY = "model/ply"
_AUTHOR = "reconstruction"


def reconstruct_object(
    context: Context, object_iri: NamedNode, access: Access
) -> tuple[StoredMesh, str]:
    """Reconstruct the surface of an object and store it in place of the caller's earlier ones.

    Returns
    -------
    StoredMesh
    str
        Name of the commit.

    Raises
    ------
    DataError
        The object has no model, or too few points of it were measured.
    """
    from features.modelling import mesh_to_ply, reconstruct
    from features.modelling.reconstruction import METHOD

    found = context.models.of(object_iri)
    if found is None:
        raise DataError(f"{object_iri.value} has no model of its views; show it once more")
    model_node, model = found
    try:
        # Takes about a second: others may write meanwhile.
        made = reconstruct(model)
    except ValueError as error:
        raise DataError(f"no surface of {object_iri.value}: {error}") from error
    author = context.author(access, _AUTHOR)
    with context.writing:
        kb = context.kb
        mesh = context.names.unique("mesh")
        data = mesh_to_ply(made.vertices, made.faces, made.colours, made.seen)
        triples = Triples()
        triples.add(object_iri, RT.hasFeature, mesh)
        triples.node(
            mesh,
            [RT.TriangleMesh],
            {RT.hasBlob: triples.blob(kb.blobs.put(data, _PLY)),
             RT.vertexCount: len(made.vertices), RT.faceCount: len(made.faces),
             RT.seenShare: made.seen_share, RT.medianResidual: made.median_residual_m,
             RT.residual90: made.residual_90_m, RT.isWatertight: made.is_watertight,
             RT.reconstructionMethod: METHOD, PROV.wasDerivedFrom: model_node.iri},
        )  # fmt: skip
        for name, _ in model.sources:
            triples.add(mesh, PROV.wasDerivedFrom, iri(name))
        graph = context.home_graph(author)
        with kb.transaction(access=author, note="reconstruct a surface") as tx:
            for subject, predicate, value in _earlier(kb, object_iri, graph):
                tx.remove(subject, predicate, value, graph)
            triples.write(tx)
        commit = context.commit_id(tx.commit)
    stored = stored_mesh(kb, object_iri)
    assert stored is not None
    return stored, commit


def _earlier(kb: GraphCore, object_iri: NamedNode, graph: NamedNode) -> list[Stated]:
    """Return the statements of reconstructed surfaces of an object in one graph."""
    quads: list[Stated] = []
    for link in kb.match(object_iri, RT.hasFeature, graph=graph):
        mesh = link.object
        if isinstance(mesh, NamedNode) and kb.match(mesh, RT.seenShare, graph=graph):
            quads.append((object_iri, RT.hasFeature, mesh))
            quads += [(mesh, quad.predicate, quad.object) for quad in kb.match(mesh, graph=graph)]
    return quads
