"""Sessions: units of work with one object per IRI and one transaction for all changes."""

from __future__ import annotations

import warnings
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, NoReturn, TypeVar

from rtask.errors import DataError, UnknownTermError, UsageError
from rtask.model.annotations import Note, read_annotations
from rtask.model.backing import Backed, Statements, Touched, Writes
from rtask.model.flush import Flush, named
from rtask.model.identity import IdentityMap
from rtask.model.instance import Annotation, Model, Property, absent, field_of
from rtask.model.query.builder import Query
from rtask.model.query.plan import Plan, finished
from rtask.model.reading import Lazy, Reader
from rtask.model.view import View
from rtask.rdf.namespaces import mint
from rtask.rdf.terms import GraphName, NamedNode, iri
from rtask.sparql.results import Solutions

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["Session"]

_ELSEWHERE = {
    "add_all": "add() for each object; what it refers to is added with it",
    "merge": "get(Model, iri), and set the fields of that object",
    "execute": "query(Model), or select(text) for SPARQL",
    "scalars": "query(Model).all()",
    "scalar": "query(Model).one()",
    "expire": "refresh(instance)",
    "expunge": "rollback(), or close()",
    "begin": "the session itself as a with block",
}
"""Names of SQLAlchemy, and what does the same here."""
M = TypeVar("M", bound=Model)


class Session:
    """Unit of work of one agent on the objects of a knowledge base.

    As a context manager it writes all changes as one transaction when the block ends, and none
    if the block raises an exception. A session belongs to one thread.

    Parameters
    ----------
    kb
        The knowledge base.
    agent
        Who writes; without an agent, statements go to the shared graph.
    note
        Stored with the provenance of the changes.
    lazy
        How to handle access, in a loop over results, to data that the query did not read:
        ``"raise"`` :class:`LazyLoadError`, ``"warn"``, or ``"allow"`` one query per object.
    inferred
        Whether derived statements are visible; if not, subclasses and inverses are spelled out in
        queries. By default the setting of the knowledge base.
    check_required
        Whether new objects must have the values that their shapes require.
    autoflush
        Whether queries first write the changes so far, so that they see them. This is a commit,
        which an exception later in the block does not undo.

    Examples
    --------
    >>> import rtask
    >>> from rtask.model import RTASK
    >>> kb = rtask.open(":memory:")
    >>> with kb.session(agent="nao-1") as s:
    ...     mug = RTASK.Mug(object_id="lab/mug-1", mass=0.3)
    ...     s.add(mug)
    >>> with kb.session() as s:
    ...     s.query(RTASK.Container).where(RTASK.Container.mass < 0.5).one().object_id
    'lab/mug-1'
    >>> kb.close()
    """

    def __init__(
        self,
        kb: GraphCore | Backed,
        agent: str | None = None,
        *,
        note: str | None = None,
        lazy: Lazy = "raise",
        inferred: bool | None = None,
        check_required: bool = True,
        autoflush: bool = False,
    ) -> None:
        if lazy not in ("raise", "warn", "allow"):
            raise UsageError(f"lazy: expected 'raise', 'warn' or 'allow', not {lazy!r}")
        self.view = View(kb, agent, inferred)
        self.note = note
        self.check_required = check_required
        self.autoflush = autoflush
        self._new: dict[Model, None] = {}
        self._dirty: dict[Model, None] = {}
        self._deleted: dict[Model, None] = {}
        self._notes: list[Note] = []
        self.identities = IdentityMap(self._dirty)
        self.reader = Reader(self, self.view, self.identities, lazy)
        self._stop = self.view.backing.on_touched(_weak_listener(self.identities))

    @property
    def kb(self) -> GraphCore | Backed:
        """The knowledge base."""
        return self.view.kb

    @property
    def agent(self) -> str | None:
        """The agent who writes; ``None`` for the shared graph."""
        return self.view.agent

    @property
    def inferred(self) -> bool:
        """Whether derived statements are visible."""
        return self.view.inferred

    if not TYPE_CHECKING:  # type checkers name attributes that are not there themselves

        def __getattr__(self, name: str) -> NoReturn:
            raise absent("session", name, _ELSEWHERE)

    # Life

    def __reduce__(self) -> NoReturn:
        raise UsageError(
            "a session is neither pickled nor copied; open the knowledge base in the other process "
            "and begin one there"
        )

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self.flush()
        finally:
            self.close()

    def __del__(self) -> None:
        if not hasattr(self, "_stop") or self.view.closed:
            return
        self._stop()
        if self._has_changes():
            who = self.agent or "nobody"
            warnings.warn(
                f"a session of {who} was dropped with changes that were never written; use it in a"
                " with block, or call commit(), rollback() or close()",
                ResourceWarning,
                stacklevel=2,
            )

    def _has_changes(self) -> bool:
        return bool(self._new or self._dirty or self._deleted or self._notes)

    def close(self) -> None:
        """Discard unwritten changes; objects can no longer be read or changed."""
        if not self.view.closed:
            self._stop()
            self.view.closed = True

    # Asking

    def query(self, model: type[M]) -> Query[M]:
        """Return a query for the objects of a class, subclasses included."""
        return Query(self, Plan(model, inferred=self.inferred))

    def get(self, model: type[M], name: str | NamedNode) -> M:
        """Return the object of an IRI; the same object for repeated calls.

        Raises
        ------
        UnknownTermError
            If the graph states nothing about it, or it belongs to another class.
        """
        instance = self.find(model, name)
        if instance is None:
            raise UnknownTermError(f"the graph knows no {model.__name__} {iri(name)}")
        return instance

    def find(self, model: type[M], name: str | NamedNode) -> M | None:
        """Return the object of an IRI, or ``None`` if the graph states nothing about it."""
        text = _checked_iri(model, name)
        instance = self.identities.find(text)
        if instance is not None and instance.__state__.deleted:
            return None
        if instance is None or not (instance.__state__.is_read or instance.__state__.new):
            return self.reader.fetch(model, text)
        if not isinstance(instance, model):
            raise UnknownTermError(f"{text} is a {type(instance).__name__}, not a {model.__name__}")
        return instance

    def known(self, name: str) -> Model | None:
        """Return the object of an IRI if this session has one; nothing is read."""
        return self.identities.find(name)

    def select(self, text: str) -> Solutions:
        """Run a SELECT in the knowledge base as this session sees it; known prefixes are added."""
        return self.view.select(text)

    def ask(self, text: str) -> bool:
        """Run an ASK in the knowledge base as this session sees it; known prefixes are added."""
        return self.view.holds(finished(text))

    def annotations(self, instance: Model, field: Property) -> list[Annotation]:
        """Return the annotations of a field's statements, by value and reifier."""
        return read_annotations(self.view, instance, field)

    def stated_by(self, instance: Model, name: str) -> list[tuple[object, str]]:
        """Return each value of a field with the graphs that state it."""
        field = field_of(instance, name)
        quads = self.kb.match(NamedNode(instance.iri), NamedNode(field.iri))
        values = field.python(instance, [quad.object for quad in quads])
        graphs = [getattr(quad.graph_name, "value", "") for quad in quads]
        return list(zip(values, graphs, strict=True))

    # Changing

    def add(self, instance: Model) -> None:
        """Add a new object, with all new objects that it refers to."""
        self.view.check_open()
        state = instance.__state__
        if state.session is self:
            return
        if state.session is not None:
            raise UsageError(f"{instance!r} belongs to another session")
        if state.iri is None:
            state.iri = mint(self.kb.base, type(instance).__name__)
        if self.identities.find(state.iri) is not None:
            raise UsageError(f"this session has another object for {state.iri}")
        state.session = self
        self.identities.add(state.iri, instance)
        self._new[instance] = None
        for pending in state.pending.values():
            for item in pending.added:
                if isinstance(item, Model) and item.__state__.session is None:
                    self.add(item)

    def delete(self, instance: Model, cascade: Iterable[str] = ()) -> None:
        """Withdraw the agent's own statements about an object, and those that point to it.

        What others state about it stays, and the object with it: writing then warns. It is an
        :class:`~rtask.errors.OwnershipError` if others state all of it.

        Parameters
        ----------
        cascade
            Names of fields whose objects are deleted too.
        """
        if instance.__state__.session is not self:
            raise UsageError(f"{instance!r} does not belong to this session")
        for name in cascade:
            value = getattr(instance, name)
            others = [value] if isinstance(value, Model) else list(value or ())
            for other in others:
                self.delete(other)
        instance.__state__.deleted = True
        if instance in self._new:
            del self._new[instance]
        else:
            self._deleted[instance] = None

    def annotate(self, instance: Model, name: str, value: object = None, **notes: object) -> None:
        """Annotate one statement, for instance with ``confidence=0.8``.

        Parameters
        ----------
        name
            Name of the field.
        value
            Which value, if the field has several.
        **notes
            Fields that any resource may have, e.g. ``confidence``, ``valid_until``, ``comment``.
        """
        self.view.check_open()
        self._notes.append(Note.of(instance, name, value, notes))

    @property
    def new(self) -> list[Model]:
        """Objects that are not yet in the graph."""
        return list(self._new)

    @property
    def dirty(self) -> list[Model]:
        """Known objects with changes."""
        return [item for item in self._dirty if item not in self._new]

    @property
    def deleted(self) -> list[Model]:
        """Objects to be withdrawn."""
        return list(self._deleted)

    def mark(self, instance: Model) -> None:
        """Note that an object has changes; fields call it."""
        self.view.check_open()
        if instance.__state__.deleted:
            raise UsageError(f"{instance!r} was deleted")
        self._dirty[instance] = None

    def flush(self) -> Commit | None:
        """Write all changes as one transaction; return the commit, ``None`` without changes.

        Raises
        ------
        FieldError
            If a new object lacks a required value.
        OwnershipError
            If a value to replace, or all of an object to delete, is stated by another agent.
        VersionConflictError
            If somebody else changed a value that was read and is to be replaced.
        """
        self.view.check_open()
        flush = Flush(self.view, self._new, self.dirty, self._deleted)
        if not flush and not self._notes:
            return None
        if self.check_required:
            flush.check_required()

        def write(tx: Writes, statements: Statements) -> None:
            flush.write(tx, statements)
            for note in self._notes:
                note.write(self.kb.base, tx, named(self.home))

        commit = self.view.backing.write(write, flush.subjects(), self.agent, self.note)
        flush.settle()
        for instance in flush.stays:
            warnings.warn(
                f"{instance!r} stays: others state more about it than was deleted here",
                stacklevel=2,
            )
        for instance in self._deleted:
            self.identities.drop(instance.iri)
        for changes in (self._new, self._dirty, self._deleted):
            changes.clear()
        self._notes = []
        return commit

    def commit(self) -> Commit | None:
        """Write all changes as one transaction; the same as :meth:`flush`."""
        return self.flush()

    def rollback(self) -> None:
        """Discard unwritten changes and cached values; the session remains usable.

        New objects leave the session and keep their values. What was flushed stays written.
        """
        self.view.check_open()
        new = list(self._new)
        # the other side of an inverse may have changes without being written itself
        for instance in {*self.identities.all(), *self._new, *self._dirty, *self._deleted}:
            state = instance.__state__
            state.deleted = False
            if state.new:
                new.append(instance)
            else:
                state.pending.clear()
                state.forget()
        for instance in dict.fromkeys(new):
            self.identities.drop(instance.iri)
            instance.__state__.session = None
        for changes in (self._new, self._dirty, self._deleted):
            changes.clear()
        self._notes = []

    @contextmanager
    def no_autoflush(self) -> Iterator[None]:
        """Write nothing before queries while the block runs."""
        before, self.autoflush = self.autoflush, False
        try:
            yield
        finally:
            self.autoflush = before

    def flush_before_query(self) -> None:
        """Write the changes so far if the session does so before queries."""
        if self.autoflush and self._has_changes():
            self.flush()

    @property
    def home(self) -> GraphName:
        """The graph that this session writes."""
        return self.view.home

    def refresh(self, instance: Model) -> None:
        """Discard the cached values of an object; unwritten changes stay."""
        instance.__state__.forget()

    def __repr__(self) -> str:
        return f"<Session of {self.agent or 'nobody'} on {self.kb!r}>"


def _checked_iri(model: type[Model], name: str | NamedNode) -> str:
    """Return the IRI of an object; the identifiers that people write are values of a field."""
    try:
        return iri(name).value
    except DataError as error:
        raise DataError(
            f"{error}; to find it by a field, query({model.__name__}).where("
            f"{model.__name__}.object_id == {name!r}).one(), or another field"
        ) from error


def _weak_listener(identities: IdentityMap) -> Callable[[Touched], None]:
    """Return a listener that does not keep the session alive: the map refers to what changed."""
    identities_ref = weakref.ref(identities)

    def hear(touched: Touched) -> None:
        identities_alive = identities_ref()
        if identities_alive is not None:
            identities_alive.hear(touched)

    return hear
