"""Property paths of a query as they are read, and the predicates that they walk."""

from __future__ import annotations

from rtask.asking.check.syntax.outline import Node, Step

__all__ = ["REPETITIONS", "Path", "links_of", "steps_of"]


REPETITIONS = ("repeated", "loose", "optional")
"""Kinds of the paths ``p+``, ``p*`` and ``p?``."""


class Path:
    """A property path as it is read."""

    __slots__ = ("end", "kind", "node", "parts", "start")

    def __init__(
        self,
        kind: str,
        parts: list[Path] | None = None,
        node: Node | None = None,
        start: int = 0,
        end: int = 0,
    ) -> None:
        self.kind, self.parts, self.node = kind, parts or [], node
        self.start, self.end = start, end


def steps_of(path: Path) -> list[Step]:
    """Return the predicates of a simple path; none for one that is not."""
    if path.kind == "link" and path.node is not None:
        return [Step(path.node)]
    if path.kind == "inverse":
        return [Step(step.node, not step.is_inverse) for step in steps_of(path.parts[0])]
    if path.kind == "alternative":
        step_lists = [steps_of(part) for part in path.parts]
        return [step for steps in step_lists for step in steps] if all(step_lists) else []
    return []


def links_of(path: Path) -> list[Node]:
    own = [path.node] if path.node is not None else []
    return [*own, *(node for part in path.parts for node in links_of(part))]
