"""Why a statement holds, as lines of text: who asserts it, or from what it follows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rtask.rdf.terms import NamedNode, Value

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["proof_lines"]


def proof_lines(
    kb: KnowledgeBase, subject: NamedNode, predicate: NamedNode, value: Value
) -> list[str]:
    """Return the reasoner's proof of a statement; what is asserted names its graphs.

    Empty when the statement does not hold, or holds no more.
    """
    graphs = [quad.graph_name for quad in kb.match(subject, predicate, value)]
    asserted = [graph for graph in graphs if graph != kb.graphs.inferred]
    if asserted:
        where = ", ".join(sorted(str(graph) for graph in asserted))
        return [f"{subject} {predicate} {value} asserted in {where}"]
    if not kb.reasons:
        return []
    found = kb.explain(subject, predicate, value)
    return [] if found is None else found.render().splitlines()
