"""SHACL validation of the nodes that a commit touches, or of all data.

The validator receives only the shapes that target the touched nodes, and only the statements
that those shapes examine, so the cost depends on the size of the change and not of the store.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import ontology
from rtask.errors import DataError, ParseError, UsageError, ValidationError
from rtask.kb.shapes.reading import (
    Shapes,
    is_of_shapes,
    of_graphs,
    part_of_shape,
    read_shapes,
    unprivileged_graphs,
    without_targets,
)
from rtask.kb.shapes.surroundings import ShapeView
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.quads import Derived
from rtask.rdf.terms import GraphName, NamedNode, Term, TripleKey

__all__ = ["ValidationReport", "Validator", "Violation", "policy", "shape_files"]

_TARGET_NODE = NamedNode("http://www.w3.org/ns/shacl#targetNode")
_BATCH = 200
"""Nodes validated at once: pySHACL compares each focus node with all others."""

_POLICIES = ("off", "warn", "refuse")


@dataclass(frozen=True)
class Violation:
    """One result of a validation (SHACL 3.6); terms are written as in N-Triples.

    Parameters
    ----------
    path, value
        ``None`` for a constraint on the node itself.
    severity
        ``Violation``, ``Warning`` or ``Info``.
    graph
        IRI of the graph that was validated by itself; ``None`` if all were validated together.
    """

    focus: str
    path: str | None
    value: str | None
    message: str
    shape: str
    severity: str
    graph: str | None = None

    def __str__(self) -> str:
        path = f" {self.path}" if self.path else ""
        value = f" {self.value}" if self.value else ""
        return f"{self.focus}{path}{value}: {self.message}"


def shape_files(shapes: Path | str | Iterable[Path | str]) -> tuple[Path, ...]:
    """Return files of shapes after reading them once.

    Raises
    ------
    DataError
        A file cannot be read, does not parse, or holds a shape that cannot be applied; names it.
    """
    listed = [shapes] if isinstance(shapes, Path | str) else list(shapes)
    files = tuple(Path(file) for file in listed)
    # Read now, since an error in a file of shapes should not wait for the first commit.
    for file in files:
        try:
            left_out = read_shapes((file,), bundled=False).left_out
        except SyntaxError as error:
            raise ParseError(f"{file}:{error.lineno}:{error.offset}: {error.msg}") from error
        except (OSError, ValueError) as error:
            raise DataError(f"{file}: the shapes cannot be read: {error}") from error
        if left_out:
            raise DataError(f"{file}: a shape cannot be applied: {'; '.join(left_out)}")
    return files


def policy(validate: bool | str) -> str:
    """Return how violations are handled: ``off``, ``warn`` or ``refuse``.

    >>> policy(True), policy("warn")
    ('refuse', 'warn')
    """
    name = validate if isinstance(validate, str) else "refuse" if validate else "off"
    if name not in _POLICIES:
        raise UsageError(f"validate={validate!r}; one of False, True, {', '.join(_POLICIES)}")
    return name


class ValidationReport(list[Violation]):
    """Results of a validation, and the shapes that led to them.

    An empty report means that the data conform to ``shapes``, and to no others.

    Parameters
    ----------
    results
        In a fixed order.
    shapes
        The shapes applied, each with the file or graph that it comes from; those of the ontology
        that comes with RTASK without.
    left_out
        The shapes that were not applied, each with the reason.
    """

    def __init__(
        self,
        results: Iterable[Violation] = (),
        shapes: Iterable[str] = (),
        left_out: Iterable[str] = (),
    ) -> None:
        super().__init__(results)
        self.shapes = tuple(shapes)
        self.left_out = tuple(left_out)

    @property
    def conforms(self) -> bool:
        """Whether no result has severity Violation (SHACL 3.1 counts any result)."""
        return all(result.severity != "Violation" for result in self)


class Validator:
    """Checks changes of one knowledge base against shapes.

    The shapes are those that come with the ontology, those of loaded graphs, and those of files.
    Shapes in the graphs of robots and in the shared graph bind no commits: anybody could then
    refuse what others store. Nor do shapes with SPARQL, which may look at any statement.

    Parameters
    ----------
    refuse
        Whether a violation rejects the commit; otherwise the commit reports it as a warning.
    files
        Further files of shapes.
    """

    def __init__(
        self, store: GraphStore, graphs: Graphs, refuse: bool, files: Iterable[Path] = ()
    ) -> None:
        self._store = store
        self._graphs = graphs
        self._refuse = refuse
        self._files = tuple(files)
        self._loaded: Shapes | None = None

    def beside(self, store: GraphStore) -> Validator:
        """Return a validator of the same policy and files for a copy of the store."""
        return Validator(store, self._graphs, self._refuse, self._files)

    def check(self, change: Overlay, derived: Derived) -> ValidationReport:
        """Validate the nodes that a pending change touches, in their state after it.

        Raises
        ------
        ValidationError
            If a node violates a shape; ``results`` lists the violations and nothing is stored.
        """
        # Shapes see what holds after the commit: what is derived belongs to it.
        whole = Overlay(self._store)
        for part in (change, derived):
            whole.removed.update(dict.fromkeys(part.removed))
            whole.added.update(dict.fromkeys(part.added))
        report = ValidationReport()
        for shapes in self._shapes(change):
            self._check(ShapeView(whole, None), shapes, report)
        for graph in sorted(change.touched_graphs(), key=str):
            if self._graphs.owner(graph) is not None:
                shapes = read_shapes(tuple(ontology.graph_shapes()))
                self._check(ShapeView(whole, graph), shapes, report)
        if self._refuse:
            refuse(report)
        return report

    def _shapes(self, change: Overlay) -> list[Shapes]:
        """Return the shapes that hold before a change; its own bind the commits after it."""
        if self._loaded is None:
            # A robot's own graph may hold shapes, but they must not refuse what others write.
            apart = unprivileged_graphs(self._graphs, self._store.named_graphs())
            self._loaded = of_graphs(self._store, {self._graphs.inferred, *apart}).local()
        loaded, changed = self._loaded, (*change.added, *change.removed)
        defines = change.dropped or any(map(is_of_shapes, changed))
        if defines or any(part_of_shape(quad.subject) in loaded.nodes for quad in changed):
            self._loaded = None
        own = read_shapes(tuple(ontology.shapes()))
        given = read_shapes(self._files, bundled=False).local() if self._files else Shapes(())
        return [own, *(shapes for shapes in (loaded, given) if shapes.shapes)]

    def _check(self, view: ShapeView, shapes: Shapes, report: ValidationReport) -> None:
        roles = {node: view.roles(node, shapes.objects_of) for node in view.touched(shapes)}
        chosen = shapes.of({role for violations in roles.values() for role in violations})
        if not chosen:
            return
        definitions = without_targets(shapes.definitions(chosen))
        targets = {role for shape in chosen for role in shape.targets}
        # A node may be touched only as the value of another, whose shape looks at it.
        focus = [node for node, violations in roles.items() if not violations.isdisjoint(targets)]
        depth = max(shape.depth for shape in chosen)
        violations: list[Violation] = []
        for start in range(0, len(focus), _BATCH):
            part = focus[start : start + _BATCH]
            around = view.around(part, shapes, depth)
            # Not the validator's own choice of focus nodes, which it also applies to nested shapes.
            aimed = [
                (shape.node, _TARGET_NODE, node)
                for node in part
                for shape in chosen
                if not shape.targets.isdisjoint(roles[node])
            ]
            violations += run(around, [*definitions, *aimed], view.graph)
        report += sorted(violations, key=str)
        report.shapes = tuple(dict.fromkeys((*report.shapes, *(s.name for s in chosen))))


def refuse(report: ValidationReport) -> None:
    """Raise if any result has severity Violation."""
    bad = [violation for violation in report if violation.severity == "Violation"]
    if not bad:
        return
    more = f" (and {len(bad) - 1} more)" if len(bad) > 1 else ""
    raise ValidationError(
        f"the data violate a SHACL shape: {bad[0]}{more}; nothing was stored",
        results=[asdict(violation) for violation in bad],
        shapes=list(report.shapes),
    )


def everything(store: GraphStore, graphs: Graphs, files: Iterable[Path] = ()) -> ValidationReport:
    """Validate a whole knowledge base.

    Parameters
    ----------
    files
        Further files of shapes.
    """
    whole = Overlay(store)
    own = read_shapes(tuple(ontology.shapes()))
    loaded = of_graphs(store, {graphs.inferred})
    given = read_shapes(tuple(files), bundled=False)
    report = ValidationReport()
    data = ShapeView(whole, None).triples()
    for shapes in (own, loaded, given):
        if shapes.shapes:
            report += run(data, shapes.definitions(shapes.shapes), None)
            report.shapes += tuple(shape.name for shape in shapes.shapes)
        report.left_out += shapes.left_out
    for graph in sorted(store.named_graphs(), key=str):
        if graphs.owner(graph) is not None:
            shapes = read_shapes(tuple(ontology.graph_shapes()))
            triples = ShapeView(whole, graph).triples()
            report += run(triples, shapes.definitions(shapes.shapes), graph)
            report.shapes += tuple(f"{s.name} in {graph}" for s in shapes.shapes)
    return report


def run(
    data: Iterable[TripleKey],
    shapes: Iterable[tuple[Term, NamedNode, Term]],
    graph: GraphName | None,
) -> list[Violation]:
    """Validate statements, those of one graph only if one is given."""
    from reasoner.shacl import ShapesError, validate

    # triple terms are left out: the validator's signature does not include them
    given: Any = (key for key in data if not hasattr(key[2], "subject"))
    try:
        report = validate(given, list(shapes))  # type: ignore[arg-type]
    except ShapesError as error:
        raise DataError(f"the SHACL shapes cannot be applied: {error}") from error
    return [
        Violation(
            str(finding.focus),
            finding.path,
            None if finding.value is None else str(finding.value),
            finding.message,
            str(finding.shape),
            finding.severity,
            getattr(graph, "value", None),
        )
        for finding in report.findings
    ]
