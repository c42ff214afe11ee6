"""Bridge to rdflib: the graph as an ``rdflib.Dataset``, read in place, written as one commit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any

import pyoxigraph as ox
import rdflib
from rdflib.query import Result
from rdflib.store import Store
from rdflib.term import BNode, Identifier, URIRef, Variable

import ontology
from rtask.errors import DataError, ForbiddenError, UsageError
from rtask.rdf.terms import DEFAULT, GraphName, Quad, Term, prologue, stored, stored_quad
from rtask.sparql.results import Solutions

if TYPE_CHECKING:
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["KnowledgeDataset", "from_rdflib", "to_rdflib"]

Pattern = tuple[Identifier | None, Identifier | None, Identifier | None]


class KnowledgeStore(Store):
    """An rdflib store over the graph, which collects changes until they are committed.

    Parameters
    ----------
    kb
        The knowledge base.
    home
        Graph of triples added without a graph; ``None`` makes the store read-only.
    """

    context_aware = True
    graph_aware = True
    formula_aware = False
    transaction_aware = False

    def __init__(self, kb: GraphCore, home: GraphName | None) -> None:
        super().__init__()
        self._kb = kb
        self._home = home
        self.added: set[Quad] = set()
        self.removed: set[Quad] = set()

    # Reading

    def _quads(
        self, pattern: Pattern, name: GraphName | None, stated: bool = False
    ) -> Iterator[Quad]:
        """Yield quads of a graph or of all graphs; from the union unless the graph is needed."""
        s, p, o = (None if term is None else stored(from_rdflib(term)) for term in pattern)
        apart = stated or bool(self.added or self.removed)
        where = DEFAULT if name is None and not apart else name
        for quad in self._kb.match(s, p, o, where):  # type: ignore[arg-type]
            if quad not in self.removed and not isinstance(quad.object, ox.Triple):
                yield quad
        for quad in self.added:
            fits = all(a in (None, b) for a, b in zip((s, p, o), tuple(quad)[:3], strict=True))
            if fits and name in (None, quad.graph_name):
                yield quad

    def triples(  # type: ignore[override]
        self, triple_pattern: Pattern, context: Any = None
    ) -> Iterator[tuple[tuple[Identifier, ...], Iterator[Any]]]:
        """Yield each triple of a graph, or of the union, once."""
        seen: set[tuple[Any, ...]] = set()
        for quad in self._quads(triple_pattern, graph_name(context)):
            triple = (quad.subject, quad.predicate, quad.object)
            if triple not in seen:
                seen.add(triple)
                yield tuple(map(to_rdflib, triple)), iter(())

    def __len__(self, context: Any = None) -> int:
        return sum(1 for _ in self.triples((None, None, None), context))

    def contexts(self, triple: Any = None) -> Iterator[Any]:  # type: ignore[override]
        """Yield the names of the graphs, or of those that hold a triple."""
        if triple is None or triple == (None, None, None):
            names = {*self._kb.store.named_graphs(), *(quad.graph_name for quad in self.added)}
        else:
            s, p, o = (None if term is None else stored(from_rdflib(term)) for term in triple)
            names = {quad.graph_name for quad in self._kb.match(s, p, o)}  # type: ignore[arg-type]
        for name in sorted(names, key=str):
            if isinstance(name, ox.NamedNode):
                yield URIRef(name.value)

    def query(
        self,
        query: Any,
        initNs: Mapping[str, Any],
        initBindings: Mapping[str, Identifier],
        queryGraph: str,
        **options: Any,
    ) -> Result:
        """Evaluate a query in the knowledge base, or by rdflib if there are uncommitted changes."""
        if self.added or self.removed or not isinstance(query, str):
            raise NotImplementedError
        spaces = {**ontology.PREFIXES, **{name: str(space) for name, space in initNs.items()}}
        text = prologue({name: space for name, space in spaces.items() if name}) + query
        bound = {str(name): from_rdflib(term) for name, term in initBindings.items()}
        name = graph_name(queryGraph if queryGraph != "__UNION__" else None)
        graphs = [name] if isinstance(name, ox.NamedNode) else None
        return _result(self._kb.query(text, bindings=bound, default_graphs=graphs))

    # Changing

    def _quad(self, triple: Any, context: Any) -> Quad:
        if self._home is None:
            raise ForbiddenError("this dataset is read-only; take kb.rdflib(writable=True)")
        name = graph_name(context) or self._home
        subject, predicate, value = map(from_rdflib, triple)
        return stored_quad(Quad(subject, predicate, value, name))  # type: ignore[arg-type]

    def add(self, triple: Any, context: Any, quoted: bool = False) -> None:
        """Collect a triple to assert."""
        quad = self._quad(triple, context)
        self.removed.discard(quad)
        if quad not in self._kb.store:
            self.added.add(quad)

    def remove(self, triple: Any, context: Any = None) -> None:
        """Collect triples to withdraw; ``None`` matches everything."""
        if self._home is None:
            raise ForbiddenError("this dataset is read-only; take kb.rdflib(writable=True)")
        own = list(self._quads(triple, graph_name(context), stated=True))
        for quad in own:
            if quad in self.added:
                self.added.discard(quad)
            elif quad.graph_name != self._kb.graphs.inferred:
                self.removed.add(quad)

    def add_graph(self, graph: Any) -> None:
        """Do nothing: a graph exists while it contains statements."""

    def remove_graph(self, graph: Any) -> None:
        """Collect all triples of a graph to withdraw."""
        self.remove((None, None, None), graph)


class KnowledgeDataset(rdflib.Dataset):
    """A knowledge base for code that uses rdflib.

    Reading sees the current state. Changes are visible in this dataset at once, and are written as
    one commit when the ``with`` block ends without an error.
    """

    def __init__(self, kb: GraphCore, agent: str | None, writable: bool) -> None:
        home = kb.access(agent).home() if writable else None
        self._knowledge = KnowledgeStore(kb, home)
        self._kb, self._agent = kb, agent
        super().__init__(store=self._knowledge, default_union=True)

    @property
    def default_context(self) -> Any:
        """The union; overridden because rdflib itself triggers its deprecation warning."""
        return self.default_graph

    @default_context.setter
    def default_context(self, value: Any) -> None:
        self.default_graph = value

    def __enter__(self) -> KnowledgeDataset:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.write()

    def write(self) -> Commit | None:
        """Write the changes as one commit; return ``None`` if there are none.

        Raises
        ------
        ForbiddenError, InconsistentError
            As for any commit; nothing is stored.
        """
        store = self._knowledge
        if not (store.added or store.removed):
            return None
        with self._kb.transaction(agent=self._agent, note="rdflib") as tx:
            for quad in store.removed:
                tx.remove(quad.subject, quad.predicate, quad.object, _named(quad.graph_name))
            for quad in store.added:
                tx.add(quad.subject, quad.predicate, quad.object, _named(quad.graph_name))
        store.added, store.removed = set(), set()
        return tx.commit


def _named(name: GraphName) -> ox.NamedNode | None:
    return name if isinstance(name, ox.NamedNode) else None


def _result(answer: Any) -> Result:
    if isinstance(answer, bool):
        made = Result("ASK")
        made.askAnswer = answer
        return made
    if isinstance(answer, Solutions):
        made = Result("SELECT")
        names = [Variable(name) for name in answer.variables]
        made.vars = names
        made.bindings = [
            {
                name: to_rdflib(term)
                for name, term in zip(names, row, strict=True)
                if term is not None
            }
            for row in answer
        ]
        return made
    if not hasattr(answer, "triples"):
        raise UsageError("not an answer of a query")
    made = Result("CONSTRUCT")
    made.graph = rdflib.Graph()
    for triple in answer:
        made.graph.add(tuple(map(to_rdflib, triple)))  # type: ignore[arg-type]
    return made


def to_rdflib(term: Term) -> Identifier:
    """Convert a term to rdflib; literals keep their spelling.

    Raises
    ------
    DataError
        For a triple term (RDF 1.2), which rdflib does not support.
    """
    if isinstance(term, ox.NamedNode):
        return URIRef(term.value)
    if isinstance(term, ox.BlankNode):
        return BNode(term.value)
    if isinstance(term, ox.Literal):
        if term.language:
            return rdflib.Literal(term.value, lang=term.language)
        datatype = URIRef(term.datatype.value)
        return rdflib.Literal(term.value, datatype=datatype, normalize=False)
    raise DataError("rdflib does not support triple terms (RDF 1.2); leave out the statement")


def from_rdflib(term: object) -> Term:
    """Convert a term from rdflib."""
    if isinstance(term, BNode):
        return ox.BlankNode(str(term))
    if isinstance(term, URIRef):
        return ox.NamedNode(str(term))
    if isinstance(term, rdflib.Literal):
        if term.language:
            return ox.Literal(str(term), language=term.language)
        if term.datatype is None:
            return ox.Literal(str(term))
        return ox.Literal(str(term), datatype=ox.NamedNode(str(term.datatype)))
    raise DataError(f"not an RDF term: {term!r}")


def graph_name(context: object) -> GraphName | None:
    """Return the name of an rdflib graph; ``None`` for the default graph, the union."""
    name = getattr(context, "identifier", context)
    if name is None or str(name) in ("urn:x-rdflib:default", ""):
        return None
    term = from_rdflib(name)
    return term if isinstance(term, ox.NamedNode) else None
