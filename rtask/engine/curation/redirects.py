"""Old names of objects that turned out to be others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rtask.rdf.namespaces import RT
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["followed", "present_name"]


def present_name(kb: KnowledgeBase, name: str) -> str:
    """Return the IRI of the object that this one was merged into, else its own; text stays text."""
    seen = {name}
    while ":" in name:
        try:
            node = NamedNode(name)
        except ValueError:
            return name
        onwards = [q.object for q in kb.match(node, RT.mergedInto)]
        targets = sorted(o.value for o in onwards if isinstance(o, NamedNode))
        if not targets or targets[0] in seen:
            return name
        name = targets[0]
        seen.add(name)
    return name


def followed(kb: KnowledgeBase, request: dict[str, Any]) -> dict[str, Any]:
    """Return a request in which ``object`` is its present name, at top and in ``objects``."""
    if isinstance(request.get("object"), str):
        request = {**request, "object": present_name(kb, request["object"])}
    if isinstance(request.get("objects"), list):
        request = {**request, "objects": [_entry(kb, one) for one in request["objects"]]}
    return request


def _entry(kb: KnowledgeBase, one: Any) -> Any:
    """Return one of ``objects``, which are requests themselves or names."""
    return followed(kb, one) if isinstance(one, dict) else one
