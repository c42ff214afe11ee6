"""Proofs that an object fits a request and that the robot can hold it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.engine.grippers import StoredGripper
from rtask.engine.memory.meaning import Meaning
from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode, Value, iri

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.core import GraphCore

from rtask.engine.operations.resolution.candidates import PROPERTIES, ObjectCandidate

__all__ = ["proof"]


def proof(
    context: Context, meant: Meaning, best: ObjectCandidate, gripper: StoredGripper
) -> list[str]:
    """Return the lines of a proof that the object fits and that the robot can hold it."""
    object_iri = iri(best.iri)
    lines = []
    for sense in meant.senses:
        if sense.kind == "print":
            lines.append(f'{object_iri} shows the print "{sense.words}", as read on its views')
            continue
        predicate = PROPERTIES[sense.kind]
        held = [t for t in sense.terms if context.kb.match(object_iri, predicate, iri(t))]
        for term in held[:1]:
            lines += _proof_lines(context.kb, object_iri, predicate, iri(term))
    if best.can_grasp:
        lines += _proof_lines(context.kb, gripper.robot, RT.canGrasp, object_iri)
    return lines


def _proof_lines(
    kb: GraphCore, subject: NamedNode, predicate: NamedNode, value: Value
) -> list[str]:
    """Return the reasoner's proof of a statement, or the graphs in which it is asserted.

    Empty if the statement does not hold; if that was not decided, the line says so.
    """
    graphs = [quad.graph_name for quad in kb.match(subject, predicate, value)]
    asserted = [graph for graph in graphs if graph != kb.graphs.inferred]
    if asserted:
        where = ", ".join(sorted(str(graph) for graph in asserted))
        return [f"{subject} {predicate} {value} asserted in {where}"]
    if not kb.reasons:
        return []
    explanation = kb.explain(subject, predicate, value)
    return [] if explanation.holds is False else explanation.render().splitlines()
