"""The unit of work: one object for each IRI, and one transaction for all changes."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterable
from types import TracebackType
from typing import TYPE_CHECKING, Literal, TypeVar
from weakref import WeakValueDictionary

from rtask.errors import ClosedError, UnknownTermError, UsageError
from rtask.kb.results import Solutions
from rtask.kb.terms import Graph, NamedNode, Term, iri
from rtask.model.compile import RDF_TYPE, Plan, eager, fetch_filter, finished, short
from rtask.model.errors import LazyLoadError
from rtask.model.fields import Field
from rtask.model.flush import Flush
from rtask.model.identifiers import mint
from rtask.model.instance import Model, Registry, vocabularies_of
from rtask.model.query import Query

if TYPE_CHECKING:
    from rtask.kb.commit import Change, Commit
    from rtask.kb.knowledge_base import KnowledgeBase

__all__ = ["Session"]

M = TypeVar("M", bound=Model)
Lazy = Literal["raise", "warn", "allow"]


class Session:
    """Objects of one knowledge base as one agent sees and changes them.

    As a context manager it writes all changes as one transaction when the block ends, and none
    if the block fails. A session belongs to one thread.

    Parameters
    ----------
    kb
        The knowledge base.
    agent
        Who writes; without one, statements go to the shared graph.
    note
        Kept with the provenance of what is written.
    lazy
        What happens if a loop over results reads what the query did not bring: ``"raise"``
        :class:`LazyLoadError`, ``"warn"``, or ``"allow"`` one query an object.
    inferred
        Whether derived statements are seen.
    check_required
        Whether new objects must have what their shapes ask for.

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
        kb: KnowledgeBase,
        agent: str | None = None,
        *,
        note: str | None = None,
        lazy: Lazy = "raise",
        inferred: bool = True,
        check_required: bool = True,
    ) -> None:
        if lazy not in ("raise", "warn", "allow"):
            raise UsageError(f"lazy is 'raise', 'warn' or 'allow', not {lazy!r}")
        self.kb = kb
        self.agent = agent
        self.note = note
        self.inferred = inferred
        self.check_required = check_required
        self._lazy: Lazy = lazy
        self._known: WeakValueDictionary[str, Model] = WeakValueDictionary()
        self._new: list[Model] = []
        self._dirty: list[Model] = []
        self._deleted: list[Model] = []
        self._stale: set[str] = set()
        self._stale_lock = threading.Lock()
        self._closed = False
        self._stop = kb.on_commit(self._hear)

    # Life

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

    def close(self) -> None:
        """Forget everything that was not written; objects can no longer be read or changed."""
        if not self._closed:
            self._stop()
            self._closed = True

    # Asking

    def query(self, model: type[M]) -> Query[M]:
        """Return a query for the objects of a class, subclasses included."""
        return Query(self, Plan(model, inferred=self.inferred))

    def get(self, model: type[M], name: str | NamedNode) -> M:
        """Return the object of an IRI; asked twice, the same object.

        Raises
        ------
        UnknownTermError
            If the graph says nothing about it, or says that it is something else.
        """
        found = self.find(model, name)
        if found is None:
            raise UnknownTermError(f"the graph knows no {model.__name__} {iri(name)}")
        return found

    def find(self, model: type[M], name: str | NamedNode) -> M | None:
        """Return the object of an IRI, or ``None`` if the graph says nothing about it."""
        text = iri(name).value
        known = self.known(text)
        if known is not None and known.__state__.deleted:
            return None
        if known is None or not (known.__state__.loaded or known.__state__.new):
            known = self._fetch(model, text)
        if known is None:
            return None
        if not isinstance(known, model):
            raise UnknownTermError(f"{text} is a {type(known).__name__}, not a {model.__name__}")
        return known

    def _fetch(self, model: type[Model], name: str) -> Model | None:
        facts = self._facts([name], model)[name]
        if not facts:
            return None
        types = {kind.value for kind in facts.get(RDF_TYPE, ()) if isinstance(kind, NamedNode)}
        registry = getattr(model, "__registry__", None) or Registry()
        kinds = [kind for kind in map(registry.find, types) if kind is not None]
        if kinds and not any(issubclass(kind, model) for kind in kinds):
            known = max(kinds, key=lambda kind: len(kind.__mro__)).__name__
            raise UnknownTermError(f"{name} is a {known}, not a {model.__name__}")
        return self.materialise(name, model, facts, {f.iri for f in eager(model)}, None)

    def _facts(self, names: list[str], model: type[Model]) -> dict[str, dict[str, list[Term]]]:
        """Read what comes along with objects of a class; property IRI to values, for each IRI."""
        subjects = " ".join(str(NamedNode(name)) for name in names)
        pattern = f"VALUES ?s {{ {subjects} }} ?s ?p ?o FILTER(?p IN ({fetch_filter(model)}))"
        return self._gather(names, pattern)

    def _gather(self, names: list[str], pattern: str) -> dict[str, dict[str, list[Term]]]:
        facts: dict[str, dict[str, list[Term]]] = {name: {} for name in names}
        for row in self.select(f"SELECT DISTINCT ?s ?p ?o WHERE {{ {pattern} }}"):
            subject, predicate, value = row["s"], row["p"], row["o"]
            assert isinstance(subject, NamedNode)
            assert isinstance(predicate, NamedNode)
            assert value is not None
            facts[subject.value].setdefault(predicate.value, []).append(value)
        return facts

    def select(self, text: str) -> Solutions:
        """Run a SELECT in the knowledge base as this session sees it."""
        self._check_open()
        answer = self.kb.query(finished(text), inferred=self.inferred)
        if not isinstance(answer, Solutions):
            raise UsageError("select() is for SELECT queries")
        return answer

    def ask(self, text: str) -> bool:
        """Run an ASK in the knowledge base as this session sees it."""
        self._check_open()
        return self.kb.query(finished(text), inferred=self.inferred) is True

    def stated_by(self, instance: Model, name: str) -> list[tuple[object, str]]:
        """Return who states what: each value of a field with the graph that holds it."""
        field = type(instance).__fields__[name]
        quads = self.kb.match(NamedNode(instance.iri), NamedNode(field.iri))
        values = field.python(instance, [quad.object for quad in quads])
        graphs = [getattr(quad.graph_name, "value", "") for quad in quads]
        return list(zip(values, graphs, strict=True))

    # Changing

    def add(self, instance: Model) -> None:
        """Take a new object in, with all new objects that it points to."""
        self._check_open()
        state = instance.__state__
        if state.session is self:
            return
        if state.session is not None:
            raise UsageError(f"{instance!r} belongs to another session")
        if state.iri is None:
            state.iri = mint(self.kb.base, type(instance).__name__)
        if self.known(state.iri) is not None:
            raise UsageError(f"this session has another object for {state.iri}")
        state.session = self
        self._known[state.iri] = instance
        self._new.append(instance)
        for pending in state.pending.values():
            for item in pending.added:
                if isinstance(item, Model) and item.__state__.session is None:
                    self.add(item)

    def delete(self, instance: Model, cascade: Iterable[str] = ()) -> None:
        """Withdraw the agent's own statements about an object, and those that point to it.

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
            self._new.remove(instance)
        elif instance not in self._deleted:
            self._deleted.append(instance)

    @property
    def new(self) -> list[Model]:
        """Objects that the graph does not hold yet."""
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
        self._check_open()
        if instance.__state__.deleted:
            raise UsageError(f"{instance!r} was deleted")
        if instance not in self._dirty:
            self._dirty.append(instance)

    def flush(self) -> Commit | None:
        """Write all changes as one transaction; return the commit, ``None`` without changes.

        Raises
        ------
        FieldError
            If a new object lacks what it must have.
        OwnershipError
            If a value to replace is stated by another agent.
        VersionConflictError
            If somebody else changed a value that was read and is to be replaced.
        """
        self._check_open()
        flush = Flush(self._new, self.dirty, self._deleted)
        if not flush:
            return None
        if self.check_required:
            flush.check_required()
        with self.kb.transaction(agent=self.agent, note=self.note) as tx:
            flush.write(self.kb, tx, self.home, self.inferred)
        flush.settle()
        for instance in self._deleted:
            self._known.pop(instance.iri, None)
        self._new, self._dirty, self._deleted = [], [], []
        return tx.commit

    @property
    def home(self) -> Graph:
        """The graph that this session writes."""
        return self.kb.access(self.agent).home()

    def refresh(self, instance: Model) -> None:
        """Forget what was read about an object; unwritten changes stay."""
        instance.__state__.loaded.clear()
        instance.__state__.origin = None

    # Identity

    def known(self, name: str) -> Model | None:
        """Return the object of an IRI, if this session has one."""
        self._expire()
        return self._known.get(name)

    def reference(self, name: str, model: type[Model], source: Model) -> Model:
        """Return the object of an IRI, not necessarily read yet."""
        known = self.known(name)
        if known is None:
            known = self._blank(model, name, source.__state__.origin)
        return known

    def references(self, names: list[str], model: type[Model], source: Model) -> dict[str, Model]:
        """Return the objects of several IRIs that one object points to.

        They are read with one query, unless ``source`` is one of many results: then only those
        that were prefetched are read.
        """
        found = {name: self.reference(name, model, source) for name in names}
        if source.__state__.origin is None or self._lazy == "allow":
            unread = [n for n, o in found.items() if not (o.__state__.loaded or o.__state__.new)]
            fetched = {field.iri for field in eager(model)}
            for name, facts in (self._facts(unread, model) if unread else {}).items():
                self.materialise(name, model, facts, fetched, None)
        return found

    def _blank(self, model: type[Model], name: str, origin: str | None) -> Model:
        made = model()
        state = made.__state__
        state.session, state.iri, state.new, state.origin = self, name, False, origin
        self._known[name] = made
        return made

    def materialise(
        self,
        name: str,
        asked: type[Model],
        facts: dict[str, list[Term]],
        fetched: set[str],
        origin: str | None,
    ) -> Model:
        """Return the object of an IRI with what was read about it.

        Parameters
        ----------
        facts
            Property IRI to values.
        fetched
            The properties that were asked for; those without a value have none.
        """
        known = self.known(name)
        if known is None:
            known = self._blank(asked, name, origin)
        types = [kind.value for kind in facts.get(RDF_TYPE, ()) if isinstance(kind, NamedNode)]
        registry = getattr(asked, "__registry__", None)
        if registry is not None:
            wider = type(known) if issubclass(type(known), asked) else asked
            others = vocabularies_of(self.kb).values()
            object.__setattr__(known, "__class__", registry.most_specific(types, wider, others))
        state = known.__state__
        for predicate in fetched:
            values = facts.get(predicate, [])
            state.loaded[predicate] = self._in_order(known, predicate, values)
        state.origin = origin
        return known

    def _in_order(self, instance: Model, predicate: str, values: list[Term]) -> tuple[Term, ...]:
        """Return values with the agent's own first: of a single field that is the one shown."""
        field = type(instance).__by_iri__.get(predicate)
        if field is None or not field.single or len(values) < 2:
            return tuple(values)
        own = self.kb.match(NamedNode(instance.iri), NamedNode(predicate), None, self.home)
        mine = {quad.object for quad in own}
        return tuple(sorted(values, key=lambda value: (value not in mine, str(value))))

    def load(self, instance: Model, field: Field) -> None:
        """Read one field of one object; fields call it.

        Raises
        ------
        LazyLoadError
            If the object came with others.
        """
        state = instance.__state__
        if state.origin is not None and self._lazy != "allow":
            message = (
                f"{type(instance).__name__}.{field.name} of {instance!r} did not come with the"
                f" query for {state.origin}, and asking in a loop is slow: add"
                f" .prefetch() of the path to it, or take .values()"
            )
            if self._lazy == "raise":
                raise LazyLoadError(message, field=field.name)
            warnings.warn(message, stacklevel=4)
        fetched = {field.iri}
        if field.stored and state.origin is None:
            fetched |= {f.iri for f in eager(type(instance))} - set(state.loaded)
        listed = ", ".join(map(short, sorted({RDF_TYPE, *fetched})))
        name, here = str(state.iri), f"VALUES ?s {{ {NamedNode(str(state.iri))} }}"
        pattern = f"{here} ?s ?p ?o FILTER(?p IN ({listed}))"
        if not self.inferred and not field.stored and field.inverse:
            back = f"{here} ?o {short(field.inverse)} ?s BIND({short(field.iri)} AS ?p)"
            pattern = f"{{ {pattern} }} UNION {{ {back} }}"
        facts = self._gather([name], pattern)[name]
        self.materialise(name, type(instance), facts, fetched, state.origin)

    # What others write

    def _hear(self, change: Change) -> None:
        """Note whom a commit concerns; runs in the writer's thread."""
        quads = (*change.added, *change.removed, *change.inferred_added, *change.inferred_removed)
        names = {quad.subject.value for quad in quads if isinstance(quad.subject, NamedNode)}
        with self._stale_lock:
            self._stale |= names

    def _expire(self) -> None:
        """Forget what was read about objects that changed since, unless they have changes."""
        if not self._stale:
            return
        with self._stale_lock:
            stale, self._stale = self._stale, set()
        for name in stale:
            instance = self._known.get(name)
            if instance is not None and instance not in self._dirty:
                self.refresh(instance)

    def _check_open(self) -> None:
        if self._closed:
            raise ClosedError("the session is closed; open another with kb.session()")

    def __repr__(self) -> str:
        return f"<Session of {self.agent or 'nobody'} on {self.kb!r}>"
