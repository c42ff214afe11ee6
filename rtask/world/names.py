"""Names that people give to things, products, kinds, places, frames and robots."""

from __future__ import annotations

from typing import TYPE_CHECKING

import ontology
from rtask.errors import UnknownTermError, UsageError, nearest
from rtask.rdf.namespaces import PREFIXES, RDF, RT, local_name
from rtask.rdf.terms import NamedNode, iri, literal, python_value

if TYPE_CHECKING:
    from rtask.world.state import WorldState

__all__ = [
    "MAX_EXEMPLARS",
    "find_exemplars",
    "find_frame",
    "find_marks",
    "is_exemplar",
    "label_of",
    "present",
]

MAX_EXEMPLARS = 200
"""Things that one answer is about, unless more are asked for."""


def find_exemplars(
    world: WorldState, name: str, most: int = MAX_EXEMPLARS
) -> tuple[list[tuple[str, str]], int]:
    """Return the (thing, product) pairs of an IRI, a name, an objectId or a kind.

    The thing is "" for a product that has none.

    Returns
    -------
    At most so many pairs, and how many there are beside them.
    """
    pairs: dict[tuple[str, str], None] = {}
    for node in _nodes(world, name):
        if is_exemplar(world, node):
            pairs[node, world.product_of(node)] = None
            continue
        exemplars = [
            exemplar for exemplar in world.exemplars_of(node) if is_exemplar(world, exemplar)
        ]
        pairs.update(dict.fromkeys((exemplar, node) for exemplar in exemplars))
        if not exemplars:
            pairs["", node] = None
    return list(pairs)[:most], max(len(pairs) - most, 0)


def find_frame(world: WorldState, name: str) -> str:
    """Return the frame of an IRI, a name in tf, or ``robot/name``.

    Raises
    ------
    UnknownTermError
        The graph has no such frame.
    UsageError
        Several frames have the name.
    """
    frames = world.frames.find(name)
    if not frames:
        raise UnknownTermError(f"frame: the graph has no frame {name!r}")
    if len(frames) > 1:
        raise UsageError(
            f"frame: {len(frames)} frames are called {name!r}; give the robot as well, such as "
            f"nao-1/{name}, or the IRI: {', '.join(frames)}", field="frame",
        )  # fmt: skip
    return frames[0]


def find_marks(world: WorldState, name: str) -> list[str]:
    """Return the places, robots, frames, things and products that a name may mean, as IRIs.

    Raises
    ------
    UnknownTermError
        Nothing has the name; it suggests the nearest one.
    """
    if _is_iri(name):
        return [present(world, name)]
    frames = world.frames.find(name)
    nodes = {
        quad.subject.value
        for quad in world.kb.match(None, RT.name, name)
        if isinstance(quad.subject, NamedNode)
    }
    marks = sorted({*nodes, *frames})
    if not marks:
        names = {str(python_value(quad.object)) for quad in world.kb.match(None, RT.name)}
        raise UnknownTermError(f"near: nothing is called {name!r}{nearest(name, sorted(names))}")
    return marks


def is_exemplar(world: WorldState, node: str) -> bool:
    """Whether an IRI is of a thing, and not of a product."""
    return bool(world.kb.match(iri(node), RDF.type, RT.Exemplar))


def label_of(world: WorldState, node: str) -> str:
    """Return the name of something, of a thing without one that of its product; "" for ""."""
    if not node:
        return ""
    for named in (node, world.product_of(node)):
        for quad in world.kb.match(iri(named), RT.name) if named else ():
            return _owned(world, node, str(python_value(quad.object)))
    return _owned(world, node, local_name(node))


def _owned(world: WorldState, node: str, label: str) -> str:
    """Return the label of an end effector with its robot: every robot has a "hand"."""
    for quad in world.kb.match(None, RT.hasEndEffector, iri(node)):
        if isinstance(quad.subject, NamedNode):
            for name in world.kb.match(quad.subject, RT.name):
                return f"{label} of {python_value(name.object)}"
    return label


def _is_iri(name: str) -> bool:
    return ":" in name and not any(c.isspace() for c in name)


def _nodes(world: WorldState, name: str) -> list[str]:
    if _is_iri(name):
        node = iri(present(world, name))
        whereabouts = world.kb.match(node, RT.objectId) or world.kb.match(node, RT.exemplarOf)
        return [node.value] if whereabouts else []
    word = literal(name.strip().lower())
    named = f"""
  {{ ?node rt:name ?name ; rt:objectId|rt:exemplarOf ?known FILTER(LCASE(STR(?name)) = {word}) }}
  UNION
  {{ ?node rt:objectId ?id FILTER(LCASE(STR(?id)) = {word}) }}"""
    return _select(world, named) or _select(world, _of_kind(name.strip().lower()))


def _of_kind(kind: str) -> str:
    """Return the pattern of products of a kind that has this label, also in the plural."""
    labels = {kind, kind.removesuffix("s"), kind.removesuffix("es")}
    words = ", ".join(str(literal(label)) for label in sorted(labels))
    label, other = f"<{ontology.PREFIXES['rdfs']}label>", f"<{ontology.PREFIXES['skos']}altLabel>"
    return f"""
  ?kind {label}|{other} ?label FILTER(LCASE(STR(?label)) IN ({words}))
  ?below rdfs:subClassOf* ?kind . ?node a ?below ; rt:objectId ?id"""


def _select(world: WorldState, pattern: str) -> list[str]:
    text = f"{PREFIXES}SELECT DISTINCT ?node WHERE {{{pattern} }} ORDER BY ?node"
    nodes = (present(world, str(row.value("node"))) for row in world.kb.select(text))
    return list(dict.fromkeys(nodes))


def present(world: WorldState, node: str) -> str:
    """Return the thing or product that an IRI stands for, since some were merged."""
    seen = {node}
    while True:
        targets = [
            quad.object.value
            for quad in world.kb.match(iri(node), RT.mergedInto)
            if isinstance(quad.object, NamedNode)
        ]
        if not targets or targets[0] in seen:
            return node
        node = targets[0]
        seen.add(node)
