"""Inference: derive the consequences of a change before it is stored."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Protocol, cast

from pyoxigraph import NamedNode, Quad

import ontology
from rtask.errors import DataError, InconsistentError, TooLargeError, TooMuchFollowsError
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.conflict import describe_cause, inconsistent
from rtask.kb.durability.saved_closures import Held, SavedClosures
from rtask.kb.rules.rule import Rule
from rtask.kb.rules.rulebook import blamed, stored_rules
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.minters import Minters
from rtask.kb.store.naming import Names
from rtask.kb.store.overlay import Holders, Overlay
from rtask.kb.store.quads import Derived, InGraph
from rtask.kb.store.union import input_change
from rtask.rdf.terms import GraphName, TripleKey, triple_key

if TYPE_CHECKING:
    from reasoner import ClosureTooLargeError, Config, Decision

__all__ = [
    "Derivation",
    "Inference",
    "Staged",
    "labelled",
    "reasoner_config",
    "rules_from_now_on",
    "shipped_rules",
    "too_much_follows",
]

_log = logging.getLogger(__name__)
CAUSE_BUDGET_MS = 500.0


class Staged(Protocol):
    """A derivation that is not yet visible; see :class:`reasoner.Closure`."""

    inferred_added: Collection[TripleKey]
    inferred_removed: Collection[TripleKey]
    remaining_inferred: Collection[TripleKey] | None
    contradictions: list[Any]

    def causes(self, budget_ms: float) -> list[Any]:
        """Return the smallest sets of statements behind the contradictions."""

    def prove(self, triple: Any) -> Any:
        """Return a proof of a triple that holds with the change, or ``None``."""

    def apply(self) -> None:
        """Make the derivation visible, after the store's commit."""

    def discard(self) -> None:
        """Discard the derivation."""


class Derivation(Protocol):
    """A derivation made in another process."""

    holders: Holders

    def adopt(
        self,
        gained: Sequence[TripleKey],
        lost: Sequence[TripleKey],
        rules: Sequence[Any] | None,
    ) -> Staged | None:
        """Return what follows, if it was derived from this very change."""


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

    def may_hold_equal(self) -> bool:
        """Whether any two terms are the same, as far as is known without building the closure."""
        return self._closure is None or bool(self._closure.holds_equal)

    def take_in(self, changed: Collection[TripleKey] | None) -> None:
        """Follow what another process committed, and has stored.

        Parameters
        ----------
        changed
            The asserted triples that came or went; ``None`` if that is not known, so that the
            closure is to be made again when it is needed.
        """
        from reasoner import ClosureTooLargeError

        # None until it has followed: after an error it is made again, rather than lag behind.
        closure, self._closure = self._closure, None
        if closure is None or changed is None:
            return
        if changed:
            gained = dict.fromkeys(self._present(changed))
            lost = [triple for triple in changed if triple not in gained]
            try:
                closure.stage(add=list(gained), remove=lost, accepted=True).apply()
            except ClosureTooLargeError as error:
                _log.warning("the closure cannot follow what others committed: %s", error)
                return
        self._closure = closure

    def _restore(self) -> Any:
        if self.saved is None:
            return None
        config = reasoner_config(self._graphs)
        return self.saved.restore(self._held(), self._rules_in_force(), config)

    def _held(self) -> Held:
        return Held(self._seq(), self._sizes(), self._graphs.is_input, self._present)

    def _sizes(self) -> dict[str, int]:
        """Return the number of triples of each graph that the reasoner reads and that has any."""
        sizes = {
            graph.value: self._catalogue.triple_count(graph)
            for graph in self._store.named_graphs()
            if isinstance(graph, NamedNode) and self._graphs.is_input(graph)
        }
        return {name: size for name, size in sizes.items() if size}

    def _present(self, triples: Collection[TripleKey]) -> list[TripleKey]:
        # One request for all to a store elsewhere, instead of one for each.
        self._store.prefetch({subject for subject, _, _ in triples})
        return [triple for triple in triples if self._holds(triple)]

    def _holds(self, triple: TripleKey) -> bool:
        quads = self._store.quads_for_pattern(*triple, None)
        return any(self._graphs.is_input(quad.graph_name) for quad in quads)

    def is_outdated(self) -> bool:
        """Whether other rules, or another version of the reasoner, made the inferred graph."""
        return self.saved is not None and self.saved.made_otherwise(self._rules_in_force())

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

        inputs = [graph for graph in self._store.named_graphs() if self._graphs.is_input(graph)]
        is_ontology = self._catalogue.is_ontology
        schema = self._triples(graph for graph in inputs if is_ontology(graph))
        data = self._triples(graph for graph in inputs if not is_ontology(graph))
        try:
            rules, config = self._rules_in_force(), reasoner_config(self._graphs)
            closure = Closure.build(schema, data, rules, config)
        except ClosureTooLargeError as error:
            raise TooLargeError(str(error)) from error
        _log.debug("built the closure of %d statements", closure.size)
        clashes = closure.contradictions()
        if clashes:
            _log.warning("%d contradictions, e.g. %s", len(clashes), clashes[0].message)
        return closure

    def _triples(self, graphs: Iterable[GraphName]) -> Iterator[TripleKey]:
        """Yield the statements of graphs as they are read."""
        for graph in graphs:
            yield from map(triple_key, self._store.quads_for_pattern(None, None, None, graph))

    def _rules_in_force(self) -> list[Any]:
        return [*shipped_rules(), *map(labelled, self.rules())]

    def rules(self) -> list[Rule]:
        """Return the rules of the user that the graph holds."""
        here = self._graphs.rules
        return stored_rules(self._store.quads_for_pattern(None, None, None, here))

    def is_input(self, graph: GraphName) -> bool:
        """Whether the reasoner reads a graph."""
        return self._graphs.is_input(graph)

    def stage(
        self,
        change: Overlay,
        rules: Sequence[Rule] | None = None,
        cause_ms: float = CAUSE_BUDGET_MS,
        budget: Any = None,
        gives_way: Callable[[Sequence[Any]], bool] = lambda _: False,
    ) -> tuple[Derived, Staged]:
        """Return the statements that a change adds to and removes from the inferred graph.

        Parameters
        ----------
        rules
            All rules of the user from now on, if the change concerns any.
        cause_ms
            How long to look for the causes of a contradiction.
        budget
            Bounds of what may follow, a :class:`reasoner.ChangeBudget`.
        gives_way
            Whether the change was altered because of contradictions, so that it is derived again.

        Raises
        ------
        TooMuchFollowsError
            If more follows than the budget or the configuration of the closure allows.
        InconsistentError
            If the change contradicts stored data or the ontology; the derivation is discarded.
        """
        staged = self.derive(*self.gained_and_lost(change), rules, budget)
        while staged.contradictions and gives_way(staged.contradictions):
            staged.discard()
            staged = self.derive(*self.gained_and_lost(change), rules, budget)
        if staged.contradictions:
            causes = staged.causes(budget_ms=cause_ms)
            staged.discard()
            raise self.inconsistent(staged.contradictions, causes)
        return self._derived(staged), staged

    def try_stage(
        self, change: Overlay, rules: Sequence[Rule] | None = None, budget: Any = None
    ) -> tuple[Derived, Staged | None, list[Any]]:
        """Like :meth:`stage`, but return contradictions instead of raising."""
        return self.try_derive(*self.gained_and_lost(change), rules, budget)

    def try_derive(
        self,
        gained: Sequence[TripleKey],
        lost: Sequence[TripleKey],
        rules: Sequence[Rule] | None = None,
        budget: Any = None,
    ) -> tuple[Derived, Staged | None, list[Any]]:
        """Like :meth:`try_stage`, from the asserted triples that come and go."""
        staged = self.derive(gained, lost, rules, budget)
        if staged.contradictions:
            staged.discard()
            return Derived(), None, staged.contradictions
        return self._derived(staged), staged, []

    def adopt(
        self, change: Overlay, rules: Sequence[Rule] | None, trial: Derivation
    ) -> tuple[Derived, Staged] | None:
        """Return what another process derived from a change; ``None`` if it is not that change."""
        staged = trial.adopt(*self.gained_and_lost(change), rules_from_now_on(rules))
        return None if staged is None else (self._derived(staged), staged)

    def _derived(self, staged: Staged) -> Derived:
        graph = self._graphs.inferred
        gained, lost = (
            InGraph(dict.fromkeys(part) if isinstance(part, list) else part, graph)
            for part in (staged.inferred_added, staged.inferred_removed)
        )
        if self._catalogue.revision(graph) is not None:
            # The graph holds exactly what the closure derived.
            remaining = staged.remaining_inferred
            return Derived(gained, lost, None if remaining is None else InGraph(remaining, graph))
        return Derived(gained, dict.fromkeys(quad for quad in lost if quad in self._store))

    def inconsistent(
        self, contradictions: Sequence[Any], causes: Sequence[Any] = ()
    ) -> InconsistentError:
        """Return the error that lists the contradictions and their causes."""
        return inconsistent(contradictions, causes, self.names(), self.graphs_of, self._owner_of)

    def _owner_of(self, graph: str) -> str | None:
        return self._graphs.owner(NamedNode(graph))

    def explain(self, triple: TripleKey, budget: int) -> Decision:
        """Return whether a triple holds; see :meth:`reasoner.Closure.explain`."""
        from reasoner import Proof

        names = self.names()
        decision: Decision = self.closure().explain(
            cast("Any", triple), budget, graphs_of=self.graphs_of, name=names
        )
        if decision.holds is False:
            # A graph that rules do not read may still assert it.
            quads = self._store.quads_for_pattern(*triple, None)
            graphs = sorted(str(quad.graph_name).strip("<>") for quad in quads)
            if graphs:
                gloss = " ".join(map(names, triple))
                return Proof(cast("Any", triple), gloss, "asserted", graphs=tuple(graphs))
        return decision

    def entails(self, conclusion: Iterable[TripleKey], budget: int) -> Any:
        """Return whether a conclusion follows; see :func:`reasoner.entails`."""
        from reasoner import entails

        closure, names = self.closure(), self.names()

        def explain(triple: Any) -> Any:
            return closure.explain(triple, graphs_of=self.graphs_of, name=names)

        triples = cast("Any", conclusion)  # triple terms are not among them
        return entails(closure, triples, budget=budget, explain=explain)

    def names(self) -> Names:
        """Return the short names of the terms that the graph holds now."""
        return Names(self._store, self._graphs)

    def contradictions(self) -> list[Any]:
        """Return the present contradictions among the asserted statements."""
        return list(self.closure().contradictions())

    def causes(self, budget_ms: float) -> list[dict[str, Any]]:
        """Return the smallest sets of asserted statements behind the present contradictions."""
        causes = self.closure().causes(budget_ms=budget_ms)
        names = self.names()
        return [describe_cause(cause, names, self.graphs_of) for cause in causes]

    def graphs_of(self, triple: TripleKey) -> list[str]:
        """Return the names of the graphs that assert a triple."""
        quads = self._store.quads_for_pattern(*triple, None)
        names = (quad.graph_name for quad in quads if self._graphs.is_input(quad.graph_name))
        return sorted(name.value for name in names if isinstance(name, NamedNode))

    def difference(self) -> tuple[InGraph, list[Quad]]:
        """Rebuild the closure; return the missing and the surplus quads of the inferred graph."""
        self._closure = None
        closure = self._closure = self._build()
        graph = self._graphs.inferred
        stored = self._store.quads_for_pattern(None, None, None, graph)
        missing, surplus = closure.compare(map(triple_key, stored))
        return InGraph(missing, graph), [Quad(s, p, o, graph) for s, p, o in surplus]

    def gained_and_lost(self, change: Overlay) -> tuple[list[TripleKey], list[TripleKey]]:
        """Return the triples that a change adds to and removes from what the reasoner reads."""
        return input_change(change, self._graphs.is_input)

    def derive(
        self,
        gained: Sequence[TripleKey],
        lost: Sequence[TripleKey],
        rules: Sequence[Rule] | None,
        budget: Any,
    ) -> Staged:
        """Return what follows from a change of the asserted triples, contradictions included.

        Raises
        ------
        TooMuchFollowsError
            If more follows than the budget or the configuration of the closure allows.
        NeedsRebuildError
            If everything would have to be derived again, and the budget does not include that.
        """
        from reasoner import ClosureTooLargeError, RuleError, StratificationError

        now = rules_from_now_on(rules)
        try:
            staged: Staged = self.closure().stage(add=gained, remove=lost, rules=now, budget=budget)
        except ClosureTooLargeError as error:
            raise too_much_follows(error) from error
        except (RuleError, StratificationError) as error:
            if rules is None:
                raise DataError(
                    f"with this change the rules in force would have no meaning: {error}"
                ) from error
            raise blamed(rules, self.rules(), error) from error
        return staged


def reasoner_config(graphs: Graphs) -> Config:
    """Return how the reasoner is to go about the names of contributors."""
    from reasoner import Config

    return Config(owner=Minters(graphs.base))


def too_much_follows(error: ClosureTooLargeError) -> TooMuchFollowsError:
    """Return the refusal of a change from which too much follows."""
    return TooMuchFollowsError(
        f"{error}; nothing was stored",
        rule=error.rule,
        statement=None if error.statement is None else " ".join(map(str, error.statement)),
        limit="consequences",
        allowed=error.limit,
    )


def rules_from_now_on(rules: Sequence[Rule] | None) -> list[Any] | None:
    """Return all rules as the reasoner takes them, if those of the user change."""
    return None if rules is None else [*shipped_rules(), *map(labelled, rules)]


def labelled(rule: Rule) -> Any:
    """Return a rule as the reasoner takes it."""
    from reasoner import LabelledRule

    return LabelledRule(rule.text, rule.label)


def shipped_rules() -> list[str]:
    """Return the CONSTRUCT rules that ship with the ontology."""
    return [path.read_text("utf-8") for path in ontology.rules()]
