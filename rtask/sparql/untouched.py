"""A remark for updates that remove nothing because they look at one graph only.

Patterns outside GRAPH match the union of all graphs, but templates outside GRAPH remove from the
writer's own graph, as SPARQL 1.1 Update (3.1.3) has it for the default graph. A DELETE that matches
statements of other graphs therefore succeeds and removes none of them.
"""

from __future__ import annotations

from pyoxigraph import DefaultGraph

from rtask.errors import QuerySyntaxError
from rtask.rdf.terms import GraphName
from rtask.sparql.templates import read_template
from rtask.sparql.update_outline import Operation, Update, read_update

__all__ = ["why_untouched"]


def why_untouched(text: str, home: GraphName, base: str | None = None) -> str | None:
    """Return why an update that changed nothing may have done so; none if that is no question.

    Parameters
    ----------
    text
        An update that was carried out.
    home
        Graph of templates outside GRAPH.

    Examples
    --------
    >>> print(why_untouched("DELETE WHERE { ?s <urn:p> 1 }", DefaultGraph()))
    nothing was removed: DELETE without GRAPH or WITH removes from the default graph only; \
statements of other graphs take GRAPH ?g { ... } in template and pattern
    >>> why_untouched("DELETE WHERE { GRAPH ?g { ?s <urn:p> 1 } }", DefaultGraph()) is None
    True
    """
    try:
        update = read_update(text)
        concerned = any(_removes_at_home(update, o, base) for o in update.operations)
    except QuerySyntaxError:
        return None
    if not concerned:
        return None
    where = "the default graph" if isinstance(home, DefaultGraph) else str(home)
    return (
        f"nothing was removed: DELETE without GRAPH or WITH removes from {where} only; statements "
        "of other graphs take GRAPH ?g { ... } in template and pattern"
    )


def _removes_at_home(update: Update, operation: Operation, base: str | None) -> bool:
    if operation.delete is None or operation.with_graph:
        return False
    template = read_template(update, operation.delete, operation.prologue, base)
    return any(isinstance(quad.graph_name, DefaultGraph) for quad in template)
