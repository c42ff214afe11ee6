"""Inference: derive the consequences of a change before it is stored."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol, cast

from pyoxigraph import NamedNode, Quad

import ontology
from rtask.errors import InconsistentError, TooLargeError
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.durability.saved_closures import Held, SavedClosures
from rtask.kb.rules.rule import Rule
from rtask.kb.rules.rulebook import blamed, stored_rules
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.union import input_change
from rtask.rdf.terms import GraphName, TripleKey, triple_key

__all__ = ["Inference", "Staged", "labelled", "shipped_rules"]

_log = logging.getLogger(__name__)


class Staged(Protocol):
    """A derivation that is not yet visible; see :class:`reasoner.Closure`."""

    inferred_added: Iterable[TripleKey]
    inferred_removed: Iterable[TripleKey]
    contradictions: list[Any]

    def apply(self) -> None:
        """Make the derivation visible, after the store's commit."""

    def discard(self) -> None:
        """Discard the derivation."""


class Inference:
    """Keeps the closure of all asserted graphs current.

    When a write or a proof first needs the closure, it is read from the folder, if one that fits
    was saved there, and built from the asserted graphs otherwise. The inferred graph itself is in
    the store, so queries do not need the closure.

    Parameters
    ----------
    store, graphs
        The knowledge base.
    catalogue
        Which graphs hold schema, and how many triples each graph holds.
    saved
        Closures saved in the folder; ``None`` for a store in memory.
    """

    def __init__(
        self,
        store: GraphStore,
        graphs: Graphs,
        catalogue: Catalogue,
        saved: SavedClosures | None = None,
    ) -> None:
        self._store = store
        self._graphs = graphs
        self._catalogue = catalogue
        self.saved = saved
        self._closure: Any = None
        self._seq: Callable[[], int] = lambda: catalogue.seq

    def follow(self, last_seq: Callable[[], int]) -> None:
        """Take the number of the last commit from a function."""
        self._seq = last_seq

    def closure(self) -> Any:
        """Return the closure of the asserted statements, as of the last commit."""
        if self._closure is None:
            self._closure = self._restore() or self._build()
        return self._closure

    def _restore(self) -> Any:
        if self.saved is None:
            return None
        return self.saved.restore(self._held(), self._rules_in_force())

    def _held(self) -> Held:
        return Held(self._seq(), self._sizes(), self._graphs.is_input, self._holds)

    def _sizes(self) -> dict[str, int]:
        """Return the number of triples of each graph that the reasoner reads and that has any."""
        sizes = {
            graph.value: self._catalogue.triple_count(graph)
            for graph in self._store.named_graphs()
            if isinstance(graph, NamedNode) and self._graphs.is_input(graph)
        }
        return {name: size for name, size in sizes.items() if size}

    def _holds(self, triple: TripleKey) -> bool:
        quads = self._store.quads_for_pattern(*triple, None)
        return any(self._graphs.is_input(quad.graph_name) for quad in quads)

    def prepare_save(self, always: bool = False) -> Callable[[], None] | None:
        """Copy the closure if it is there and has changed; return a function that saves the copy.

        Call this while nobody writes, after the journal is durable; the function may be called
        later.
        """
        if self.saved is None or self._closure is None:
            return None
        return self.saved.prepare(self._closure, self._seq(), self._sizes(), always)

    def is_save_due(self) -> bool:
        """Whether enough has changed since the closure was saved."""
        if self.saved is None or self._closure is None:
            return False
        return self.saved.is_due(self._closure)

    def discard_saved(self) -> None:
        """Delete the saved closures, before statements change that no journal record holds."""
        if self.saved is not None:
            self.saved.discard()

    def _build(self) -> Any:
        from reasoner import Closure, ClosureTooLargeError

        schema: list[TripleKey] = []
        data: list[TripleKey] = []
        for graph in self._store.named_graphs():
            if not self._graphs.is_input(graph):
                continue
            target = schema if self._catalogue.is_ontology(graph) else data
            for quad in self._store.quads_for_pattern(None, None, None, graph):
                target.append((quad.subject, quad.predicate, quad.object))
        _log.debug("building the closure of %d schema and %d data", len(schema), len(data))
        try:
            # the reasoner leaves out triple terms, which its signature does not include
            closure = Closure.build(
                cast("Any", schema), cast("Any", data), rules=self._rules_in_force()
            )
        except ClosureTooLargeError as error:
            raise TooLargeError(str(error)) from error
        clashes = closure.contradictions()
        if clashes:
            _log.warning("%d contradictions, e.g. %s", len(clashes), clashes[0].message)
        return closure

    def _rules_in_force(self) -> list[Any]:
        return [*shipped_rules(), *map(labelled, self.rules())]

    def rules(self) -> list[Rule]:
        """Return the rules of the user that the graph holds."""
        here = self._graphs.rules
        return stored_rules(self._store.quads_for_pattern(None, None, None, here))

    def is_input(self, graph: GraphName) -> bool:
        """Whether the reasoner reads a graph."""
        return self._graphs.is_input(graph)

    def stage(self, change: Overlay, rules: Sequence[Rule] | None = None) -> tuple[Overlay, Staged]:
        """Return the statements that a change adds to and removes from the inferred graph.

        Parameters
        ----------
        rules
            All rules of the user from now on, if the change concerns any.

        Raises
        ------
        InconsistentError
            If the change contradicts stored data or the ontology; the derivation is discarded.
        """
        derived, staged, clashes = self.try_stage(change, rules)
        if staged is None:
            raise self.inconsistent(clashes)
        return derived, staged

    def try_stage(
        self, change: Overlay, rules: Sequence[Rule] | None = None
    ) -> tuple[Overlay, Staged | None, list[Any]]:
        """Like :meth:`stage`, but return contradictions instead of raising."""
        closure = self.closure()
        gained, lost = input_change(change, self._graphs.is_input)
        staged = self._stage(closure, gained, lost, rules)
        if staged.contradictions:
            staged.discard()
            return Overlay(self._store), None, staged.contradictions
        derived = Overlay(self._store)
        graph = self._graphs.inferred
        for key in staged.inferred_removed:
            quad = Quad(*key, graph)
            if quad in self._store:
                derived.removed[quad] = None
        derived.added.update(dict.fromkeys(Quad(*key, graph) for key in staged.inferred_added))
        return derived, staged, []

    def inconsistent(self, contradictions: Sequence[Any]) -> InconsistentError:
        """Return the error that lists the contradictions."""
        message = contradictions[0].message
        more = f" (and {len(contradictions) - 1} more)" if len(contradictions) > 1 else ""
        hint = ""
        if "XMLSchema#decimal" in message:
            hint = "; a number with a point is an xsd:decimal, write 0.31e0 for an xsd:double"
        return InconsistentError(
            f"contradicts the ontology: {message}{more}{hint}; nothing was stored",
            contradictions=[self._describe(found) for found in contradictions],
        )

    def _describe(self, contradiction: Any) -> dict[str, Any]:
        """Return a contradiction as JSON-able values, with the graphs of its statements."""
        culprits: list[TripleKey] = [*contradiction.culprits()]
        return {
            "rule": contradiction.rule,
            "message": contradiction.message,
            "triples": [[str(term) for term in triple] for triple in contradiction.triples],
            "axioms": [[str(term) for term in triple] for triple in contradiction.axioms],
            "graphs": sorted({graph for triple in culprits for graph in self.graphs_of(triple)}),
        }

    def explain(self, triple: TripleKey) -> Any | None:
        """Return the proof of a triple, or ``None`` if it does not hold."""
        return self.closure().explain(triple, graphs_of=self.graphs_of)

    def graphs_of(self, triple: TripleKey) -> list[str]:
        """Return the names of the graphs that assert a triple."""
        quads = self._store.quads_for_pattern(*triple, None)
        names = (quad.graph_name for quad in quads if self._graphs.is_input(quad.graph_name))
        return sorted(name.value for name in names if isinstance(name, NamedNode))

    def difference(self) -> tuple[Iterator[Quad], list[Quad]]:
        """Rebuild the closure; return the missing and the surplus quads of the inferred graph."""
        self._closure = None
        closure = self._closure = self._build()
        graph = self._graphs.inferred
        found = self._store.quads_for_pattern(None, None, None, graph)
        missing, surplus = closure.compare(map(triple_key, found))
        return (Quad(s, p, o, graph) for s, p, o in missing), [
            Quad(s, p, o, graph) for s, p, o in surplus
        ]

    def _stage(
        self,
        closure: Any,
        gained: list[TripleKey],
        lost: list[TripleKey],
        rules: Sequence[Rule] | None,
    ) -> Staged:
        from reasoner import ClosureTooLargeError, RuleError, StratificationError

        now = None if rules is None else [*shipped_rules(), *map(labelled, rules)]
        try:
            staged: Staged = closure.stage(add=gained, remove=lost, rules=now)
        except ClosureTooLargeError as error:
            raise TooLargeError(str(error)) from error
        except (RuleError, StratificationError) as error:
            if rules is None:
                raise
            raise blamed(rules, self.rules(), error) from error
        return staged


def labelled(rule: Rule) -> Any:
    """Return a rule as the reasoner takes it."""
    from reasoner import LabelledRule

    return LabelledRule(rule.text, rule.label)


def shipped_rules() -> list[str]:
    """Return the CONSTRUCT rules that ship with the ontology."""
    return [path.read_text("utf-8") for path in ontology.rules()]
