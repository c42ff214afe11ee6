"""The statements around the nodes that a pending change touches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from pyoxigraph import BlankNode, NamedNode, Quad

from rtask.kb.shapes.reading import Shapes
from rtask.kb.store.overlay import Overlay
from rtask.rdf.terms import DEFAULT, RDF_TYPE, GraphName, Subject, Term, TripleKey, triple_key

__all__ = ["ShapeView"]

_SUBCLASS = NamedNode("http://www.w3.org/2000/01/rdf-schema#subClassOf")
_DEPTH = 2
_MAX_NODES = 5_000


class ShapeView:
    """View of the statements after a pending change, in all graphs or in one."""

    def __init__(self, change: Overlay, graph: GraphName | None) -> None:
        self._change = change
        self.graph = graph
        self._by_subject: dict[Term, set[TripleKey]] = {}
        self._by_object: dict[Term, set[TripleKey]] = {}
        self._superclasses: dict[Term, set[Term]] = {}
        for quad in change.added:
            if self._counts(quad):
                self._by_subject.setdefault(quad.subject, set()).add(triple_key(quad))
                self._by_object.setdefault(quad.object, set()).add(triple_key(quad))

    def _counts(self, quad: Quad) -> bool:
        return self.graph is None or quad.graph_name == self.graph

    def _stored(self, subject: Any, predicate: Any, value: Any) -> Iterator[TripleKey]:
        quads = self._change.store.quads_for_pattern(subject, predicate, value, self.graph)
        return (
            triple_key(quad)
            for quad in quads
            if quad.graph_name != DEFAULT and quad not in self._change.removed
        )

    def triples(self) -> set[TripleKey]:
        """Return all triples."""
        return {*self._stored(None, None, None)}.union(*self._by_subject.values())

    def about(self, node: Term) -> set[TripleKey]:
        """Return the statements with a subject."""
        return {*self._stored(node, None, None), *self._by_subject.get(node, ())}

    def pointing_at(self, node: Term, links: Iterable[NamedNode]) -> Iterator[TripleKey]:
        """Yield the statements with an object and one of some predicates."""
        for link in links:
            yield from self._stored(None, link, node)
        yield from (key for key in self._by_object.get(node, ()) if key[1] in links)

    def touched(self, shapes: Shapes) -> list[Subject]:
        """Return the nodes that the change may make invalid, up to a bound."""
        changed = [*self._change.added, *self._change.removed]
        nodes: dict[Any, None] = {}
        for quad in changed:
            if self._counts(quad):
                nodes[quad.subject] = None
                if isinstance(quad.object, NamedNode | BlankNode) and quad.predicate != RDF_TYPE:
                    nodes[quad.object] = None
        edge = [*nodes]
        most = len(nodes) + _MAX_NODES
        for _ in range(max(_DEPTH, shapes.depth)):
            beyond: dict[Any, None] = {}
            for node in edge:
                for key in self.pointing_at(node, shapes.links):
                    beyond[key[0]] = None
                for key in self.followed(node, shapes.inverse):
                    beyond[key[2]] = None
            edge = [node for node in beyond if node not in nodes]
            if not edge:
                break
            nodes.update(dict.fromkeys(edge))
            if len(nodes) > most:
                break
        return list(nodes)

    def roles(self, node: Subject, objects_of: Iterable[NamedNode]) -> set[tuple[str, Term]]:
        """Return the shape targets that a node matches."""
        roles: set[tuple[str, Term]] = {("targetNode", node)}
        for _, predicate, value in self.about(node):
            roles.add(("targetSubjectsOf", predicate))
            if predicate == RDF_TYPE:
                roles |= {("targetClass", kind) for kind in self._with_superclasses(value)}
        roles |= {
            ("targetObjectsOf", link)
            for link in objects_of
            if any(True for _ in self.pointing_at(node, (link,)))
        }
        return roles

    def _with_superclasses(self, kind: Term) -> set[Term]:
        cached = self._superclasses.get(kind)
        if cached is not None:
            return cached
        superclasses, waiting = {kind}, [kind]
        while waiting:
            below = waiting.pop()
            if not isinstance(below, NamedNode | BlankNode):
                continue  # a class that somebody wrote as text, which nothing is above
            for _, _, above in self._stored(below, _SUBCLASS, None):
                if above not in superclasses:
                    superclasses.add(above)
                    waiting.append(above)
        self._superclasses[kind] = superclasses
        return superclasses

    def followed(self, node: Term, predicates: frozenset[NamedNode]) -> Iterator[TripleKey]:
        """Yield the statements about a node with one of some predicates, and a node as object."""
        if predicates and isinstance(node, NamedNode | BlankNode):
            for key in self.about(node):
                if key[1] in predicates and isinstance(key[2], NamedNode | BlankNode):
                    yield key

    def around(self, focus: Iterable[Subject], shapes: Shapes, depth: int) -> set[TripleKey]:
        """Return the statements that shapes of these nodes examine, with the classes of values.

        Parameters
        ----------
        depth
            Steps from the nodes; beyond the first few, only along the paths of the shapes.
        """
        back = shapes.objects_of | shapes.inverse
        surroundings: set[TripleKey] = set()
        edge: set[Any] = set(focus)
        done: set[Any] = set()
        for step in range(max(_DEPTH, depth) + 1):
            done |= edge
            about_edge = {key for node in edge for key in self.about(node)}
            pointing = {key for node in edge for key in self.pointing_at(node, back)}
            surroundings |= about_edge | pointing
            edge = {
                key[2]
                for key in about_edge
                if isinstance(key[2], NamedNode | BlankNode)
                and key[1] != RDF_TYPE
                and (step < _DEPTH or key[1] in shapes.links)
            }
            edge = (edge | {key[0] for key in pointing}) - done
            if not edge:
                break
        kinds = {key[2] for key in surroundings if key[1] == RDF_TYPE}
        for kind in kinds:
            for sub in self._with_superclasses(kind):
                surroundings.update(self._stored(sub, _SUBCLASS, None))
        return surroundings
