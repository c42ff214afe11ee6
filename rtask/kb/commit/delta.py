"""Compute the exact change of a SPARQL update before anything is stored.

Templates are filled with the solutions of each WHERE. Later operations of a request see the
changes of earlier ones through a dry run: an update that is made to fail (SPARQL 1.1 Update, 3 and
4). Rights are checked and consequences derived on the result.

A reader process, whose copy of the store may be changed, needs no dry runs: it applies each
operation before the next (:func:`evaluate_update`), within
:class:`~rtask.kb.commit.update_limits.UpdateLimits`.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from pyoxigraph import BlankNode, DefaultGraph, Literal, NamedNode, Quad

from rtask.errors import DataError, ForbiddenError, QuerySyntaxError
from rtask.kb.commit.access import Access
from rtask.kb.commit.update_limits import Meter, UpdateLimits
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.overlay import NetChange, Overlay, apply_change
from rtask.kb.store.union import union_change
from rtask.kb.store.writes import Functions, Writes, as_update
from rtask.rdf.terms import DEFAULT, GraphName, Term, stored_quad
from rtask.sparql import templates
from rtask.sparql.service import without_services
from rtask.sparql.syntax import check_update, syntax_error
from rtask.sparql.update_outline import Block, Operation, Target, Update, read_update

__all__ = ["PreparedUpdate", "UpdateDataset", "evaluate_update", "prepare", "run_update"]

_DATA = ("INSERT DATA", "DELETE DATA")
_ABORT = ["CREATE GRAPH <urn:rtask-dry:stop>"] * 2
# random names, so that no update text can call these functions
_SECRET = secrets.token_hex(8)
_RECORD = NamedNode(f"urn:rtask-dry:{_SECRET}:record")
_UNBOUND = NamedNode(f"urn:rtask-dry:{_SECRET}:unbound")


@dataclass(frozen=True)
class UpdateDataset:
    """Dataset of an update whose own text names none.

    Parameters
    ----------
    using, using_named
        Graphs given by the protocol (SPARQL 1.1 Protocol, 2.2.3); not allowed together with
        ``USING`` or ``WITH`` in the text.
    base
        IRI against which relative IRIs are resolved.
    """

    using: tuple[NamedNode, ...] = ()
    using_named: tuple[NamedNode, ...] = ()
    base: str | None = None


@dataclass(frozen=True)
class PreparedUpdate:
    """An update that was parsed and checked, which needs no lock.

    Parameters
    ----------
    templates
        Quads of the templates and DATA blocks that have been read.
    data
        What the DATA blocks add and remove. An update that is made twice makes the same blank
        nodes, so that what follows from it is the same.
    """

    update: Update
    dataset: UpdateDataset
    templates: dict[Block, list[Quad]] = field(default_factory=dict)
    data: dict[Block, list[Quad]] = field(default_factory=dict)

    @property
    def added(self) -> int:
        """Number of statements in the INSERT DATA blocks that have been read."""
        operations = self.update.operations
        return sum(len(self.data[o.insert]) for o in operations if o.insert in self.data)

    @property
    def removed(self) -> int:
        """Number of statements in the DELETE DATA blocks that have been read."""
        operations = self.update.operations
        return sum(len(self.data[o.delete]) for o in operations if o.delete in self.data)

    def template(self, operation: Operation, block: Block) -> list[Quad]:
        """Return the quads of a block, which are read once."""
        quads = self.templates.get(block)
        if quads is None:
            base = self.dataset.base
            quads = templates.read_template(self.update, block, operation.prologue, base)
            self.templates[block] = quads
        return quads

    def fill(self, operation: Operation, block: Block, home: GraphName) -> list[Quad]:
        """Return the quads of a DATA block as they are stored, those of no graph in a graph."""
        quads = self.data.get(block)
        if quads is None:
            template = self.template(operation, block)
            fresh = operation.insert is not None
            filled = templates.fill(template, {}, home, fresh=fresh)
            quads = self.data[block] = [*map(stored_quad, filled)]
        return quads


def prepare(
    text: str, dataset: UpdateDataset | None = None, home: GraphName | None = None
) -> PreparedUpdate:
    """Parse and check an update, its templates and its data, before the writers' lock is taken.

    Parameters
    ----------
    home
        Graph of the caller, to which data without a graph are added.

    Raises
    ------
    QuerySyntaxError
        With line and column.
    TooLargeError
        The text is nested too deeply, or a literal is too long.
    DataError
        Both the text and the protocol name a dataset.
    """
    prepared = _checked(text, dataset or UpdateDataset())
    for operation in prepared.update.operations:
        for block in (operation.delete, operation.insert):
            if block is None:
                continue
            prepared.template(operation, block)
            if home is not None and operation.kind in _DATA:
                prepared.fill(operation, block, home)
    return prepared


def evaluate_update(
    store: GraphStore,
    text: str,
    access: Access,
    dataset: UpdateDataset,
    limits: UpdateLimits,
    total: NetChange,
    whole: NetChange,
) -> None:
    """Execute an update on a private store, operation by operation.

    Parameters
    ----------
    store
        A private copy, which is changed even if an error is raised.
    total
        Receives the exact change of the named graphs.
    whole
        Receives all changes made in the store, those of its union graph included.

    Raises
    ------
    QueryTooExpensive
        A limit is exceeded; the error names it.
    RtaskError
        As :func:`run_update`.
    """
    prepared = _checked(text, dataset)
    meter = Meter(limits)
    for operation in prepared.update.operations:
        overlay = Overlay(store)
        _Runner(overlay, prepared, access, meter).run(operation)
        union = Overlay(store)
        if not (access.plain or store.is_view):
            union = union_change(store, overlay.removed, overlay.added)
        total.join(overlay)
        for change in (overlay, union):
            whole.join(change)
            apply_change(store, change)


def _checked(text: str, dataset: UpdateDataset) -> PreparedUpdate:
    update = read_update(without_services(text))
    check_update(update, dataset.base)
    _refuse_two_datasets(update, dataset)
    return PreparedUpdate(update, dataset)


def run_update(
    overlay: Overlay,
    prepared: PreparedUpdate,
    access: Access,
    limits: UpdateLimits | None = None,
) -> None:
    """Add the change that an update makes to an overlay.

    Parameters
    ----------
    overlay
        Pending changes that the update sees and extends.
    access
        The caller; bound to the knowledge base.

    Raises
    ------
    QueryTooExpensive
        A limit is exceeded; the error names it.
    ForbiddenError
        If the text names a graph that the caller may not write, or uses SERVICE.
    DataError
        If CREATE names an existing graph, or another operation a missing one.
    """
    runner = _Runner(overlay, prepared, access, Meter(limits))
    for operation in prepared.update.operations:
        runner.run(operation)


def _refuse_two_datasets(update: Update, dataset: UpdateDataset) -> None:
    if not (dataset.using or dataset.using_named):
        return
    if any(o.using or o.using_named or o.with_graph for o in update.operations):
        raise DataError(
            "using-graph-uri cannot be combined with USING or WITH in the update; use one of them",
            conflict="dataset",
        )


@dataclass
class _Runner:
    overlay: Overlay
    prepared: PreparedUpdate
    access: Access
    meter: Meter
    home: GraphName = field(init=False)
    update: Update = field(init=False)
    dataset: UpdateDataset = field(init=False)

    def __post_init__(self) -> None:
        self.home = self.access.home()
        self.update, self.dataset = self.prepared.update, self.prepared.dataset

    def run(self, operation: Operation) -> None:
        if operation.kind in _DATA:
            self._data(operation)
        elif operation.kind == "MODIFY":
            self._modify(operation)
        elif operation.kind == "LOAD":
            self._load(operation)
        elif operation.kind == "CREATE":
            self._create(operation)
        elif operation.kind in ("CLEAR", "DROP"):
            self._clear(operation)
        else:
            self._transfer(operation)

    def _data(self, operation: Operation) -> None:
        block = operation.insert or operation.delete
        assert block is not None
        self._template(operation, block, self.home)
        change = self.overlay.add if operation.insert is not None else self.overlay.remove
        for quad in self.meter.quads(self.prepared.fill(operation, block, self.home)):
            change(quad)

    def _template(self, operation: Operation, block: Any, home: GraphName) -> list[Quad]:
        if block is None:
            return []
        template = self.prepared.template(operation, block)
        for graph in templates.constant_graphs(template, home):
            self.access.require_write(graph, operation.kind)
        return template

    def _modify(self, operation: Operation) -> None:
        scope = operation.with_graph
        home = self._resolve(scope, operation) if scope else self.home
        delete = self._template(operation, operation.delete, home)
        insert = self._template(operation, operation.insert, home)
        names = templates.variables([*delete, *insert])
        # All solutions are those of the state before the operation (SPARQL 1.1 Update, 3.1.3):
        # nothing is changed while they are read.
        removed: list[Quad] = []
        added: list[Quad] = []
        for solution in self._solutions(operation, names):
            removed += self.meter.quads(
                templates.fill(delete, solution, home, fresh=False), stored=True
            )
            added += self.meter.quads(templates.fill(insert, solution, home, fresh=True))
        # Deletes come first there, so that a statement on both sides stays.
        for quad in removed:
            self.overlay.remove(stored_quad(quad))
        for quad in added:
            self.overlay.add(stored_quad(quad))

    def _solutions(self, operation: Operation, names: list[str]) -> Iterable[dict[str, Term]]:
        assert operation.where is not None
        where = self.update.source(operation.where)
        default, named = self._dataset(operation)
        # While nothing pends the store can answer by itself, without a scratch copy.
        if self.overlay.is_empty():
            solutions = _select(
                self.overlay.store, operation, where, names, default, named, self.dataset.base
            )
            return self.meter.solutions(solutions)
        return self._dry_run(operation, where, names, default, named)

    def _dataset(
        self, operation: Operation
    ) -> tuple[list[NamedNode] | None, list[NamedNode] | None]:
        if operation.using or operation.using_named:
            return (
                [self._resolve(name, operation) for name in operation.using],
                [self._resolve(name, operation) for name in operation.using_named],
            )
        if self.dataset.using or self.dataset.using_named:
            return list(self.dataset.using), list(self.dataset.using_named)
        if operation.with_graph:
            return [self._resolve(operation.with_graph, operation)], None
        return None, None

    def _dry_run(
        self,
        operation: Operation,
        where: str,
        names: list[str],
        default: list[NamedNode] | None,
        named: list[NamedNode] | None,
    ) -> list[dict[str, Term]]:
        """Evaluate WHERE on the pending state: apply, record the solutions, fail, roll back."""
        solutions: list[dict[str, Term]] = []
        unbound = BlankNode()

        def record(*terms: Term) -> Literal:
            pairs = zip(names, terms, strict=False)
            solutions.append({name: term for name, term in pairs if term != unbound})
            return Literal(1)

        operations, functions = as_update(self._pending())
        if default is None and self.overlay.store.is_view:
            names_now = self.overlay.named_graphs()
            default = named = [g for g in names_now if isinstance(g, NamedNode)]
        functions[_RECORD] = record
        functions[_UNBOUND] = lambda: unbound
        # A function is not called with an unbound argument, and its solution would be lost.
        values = ", ".join(f"COALESCE(?{name}, {_UNBOUND}())" for name in names)
        scope, clauses = _scope(default, named)
        # The filter keeps nothing, so that nothing is inserted: it is there to have the function
        # called.
        operations.append(
            f"{scope}INSERT {{ <urn:x> <urn:x> ?rtaskRecord }} {clauses} WHERE {{ {where} "
            f"BIND({_RECORD}({values}) AS ?rtaskRecord) FILTER(?rtaskRecord = 0) }}"
        )
        text = operation.prologue + " ;\n".join([*operations, *_ABORT])
        _run_and_roll_back(self.overlay.store.scratch(), text, functions, self.dataset.base)
        return solutions

    def _pending(self) -> Writes:
        pending = self.overlay
        union = Overlay(pending.store)
        if not (self.access.plain or pending.store.is_view):
            union = union_change(pending.store, pending.removed, pending.added)
        return Writes(
            [*pending.removed, *union.removed],
            [*pending.added, *union.added],
            list(pending.created),
            list(pending.dropped),
        )

    def _create(self, operation: Operation) -> None:
        graph = self._graph(operation.target, operation)
        self.access.require_write(graph, "CREATE")
        if not self.overlay.has_graph(graph):
            self.overlay.create(graph)
        elif not operation.silent:
            raise DataError(f"CREATE: graph {graph} exists already", exists=str(graph))

    def _clear(self, operation: Operation) -> None:
        drop = operation.kind == "DROP"
        assert operation.target is not None
        for graph in self._targets(operation):
            if operation.target.scope == "GRAPH" and not self._exists(graph, operation):
                continue
            self.overlay.clear(graph, drop)

    def _targets(self, operation: Operation) -> list[GraphName]:
        """Return the graphs of CLEAR or DROP; of ALL and NAMED, those that the caller may write."""
        target = operation.target
        assert target is not None
        if target.scope in ("GRAPH", "DEFAULT"):
            graph = self._graph(target, operation)
            self.access.require_write(graph, operation.kind)
            return [graph]
        graphs = [g for g in self.overlay.named_graphs() if self.access.may_write(g)]
        if target.scope == "ALL" and isinstance(self.home, DefaultGraph):
            graphs.append(DEFAULT)
        return graphs

    def _transfer(self, operation: Operation) -> None:
        source = self._graph(operation.source, operation)
        target = self._graph(operation.target, operation)
        self.access.require_write(target, operation.kind)
        if operation.kind == "MOVE":
            self.access.require_write(source, operation.kind)
        # No operation is performed then (SPARQL 1.1 Update, 3.2.3 to 3.2.5).
        if source == target:
            return
        is_default = operation.source is not None and operation.source.scope == "DEFAULT"
        if not is_default and not self._exists(source, operation):
            return
        quads = list(self.overlay.quads(source))
        if operation.kind != "ADD":
            self.overlay.clear(target, drop=False)
        for quad in self.meter.quads(quads, stored=True):
            self.overlay.add(Quad(quad.subject, quad.predicate, quad.object, target))
        # The target of an empty graph is an empty graph, and not none.
        self.overlay.create(target)
        if operation.kind == "MOVE":
            self.overlay.clear(source, drop=True)

    def _exists(self, graph: GraphName, operation: Operation) -> bool:
        if self.overlay.has_graph(graph):
            return True
        if operation.silent:
            return False
        raise DataError(f"{operation.kind}: graph {graph} does not exist", missing=str(graph))

    def _load(self, operation: Operation) -> None:
        # The server would fetch for callers what only it can reach, such as pages of its own
        # network.
        if not operation.silent:
            raise ForbiddenError(
                "LOAD is switched off; load a file with `rtask load` or kb.load()",
                operation="LOAD",
            )

    def _graph(self, target: Target | None, operation: Operation) -> GraphName:
        assert target is not None
        if target.scope == "DEFAULT":
            return self.home
        return self._resolve(target.name, operation)

    def _resolve(self, name: str, operation: Operation) -> NamedNode:
        return templates.resolve(name, operation.prologue, self.dataset.base)


def _scope(
    default: Sequence[NamedNode] | None, named: Sequence[NamedNode] | None
) -> tuple[str, str]:
    """Return the WITH or USING clause of a dataset."""
    if default is None:
        return "", ""
    if named is None and len(default) == 1:
        return f"WITH {default[0]} ", ""
    clauses = [f"USING {graph}" for graph in default]
    clauses += [f"USING NAMED {graph}" for graph in named or ()]
    return "", " ".join(clauses)


def _select(
    store: GraphStore,
    operation: Operation,
    where: str,
    names: list[str],
    default: list[NamedNode] | None,
    named: list[NamedNode] | None,
    base: str | None,
) -> Iterator[dict[str, Term]]:
    projection = " ".join(f"?{name}" for name in names) or "(1 AS ?one)"
    dataset: dict[str, Any] = {}
    if default is not None:
        dataset["default_graph"] = default
    if named is not None:
        dataset["named_graphs"] = named
    text = f"{operation.prologue}SELECT {projection} WHERE {where}"
    try:
        rows: Any = store.query(text, base_iri=base, **dataset)
        for row in rows:
            yield {name: row[name] for name in names if row[name] is not None}
    except SyntaxError as error:
        raise syntax_error(error, "WHERE", text) from error
    except RuntimeError as error:
        raise DataError(f"WHERE cannot be evaluated: {error}") from error


def _run_and_roll_back(
    store: GraphStore, text: str, functions: Functions, base: str | None
) -> None:
    try:
        with store.complete():
            store.update(text, base_iri=base, custom_functions=functions)
    except RuntimeError as error:
        # The dry run ends in a CREATE of what is there: the store then undoes all of the update.
        if "already exists" not in str(error):
            raise DataError(f"the update cannot be evaluated: {error}") from error
        return
    except SyntaxError as error:
        raise QuerySyntaxError(f"in WHERE: {error}") from error
    raise AssertionError("a dry run was kept")
