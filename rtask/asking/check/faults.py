"""Patterns that cannot match together: which one is at fault, and what would fit in its place."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from rtask.asking.check.by_constants import ByConstants
from rtask.asking.check.by_data import ByData
from rtask.asking.check.by_paths import ByPaths
from rtask.asking.check.by_terms import ByTerms
from rtask.asking.check.findings import Finding, Repair, Severity
from rtask.asking.check.fitting import Fitting, reversed_edge
from rtask.asking.check.naming.by_names import ByNames
from rtask.asking.check.naming.by_words import ByWords
from rtask.asking.check.repairs import Repairs
from rtask.asking.check.syntax.outline import Edge, Outline
from rtask.asking.check.types import (
    TYPE,
    Conflict,
    Context,
    Demand,
)
from rtask.asking.check.wording import demanded

__all__ = ["Faults"]


class Faults:
    """Looks for patterns of one query that conflict with others, or that the data contradict."""

    def __init__(self, fitting: Fitting, outline: Outline) -> None:
        self._vocabulary = fitting.vocabulary
        self._evidence = fitting.evidence
        self._fitting = fitting
        self._repairs = Repairs(self._fitting, outline)
        self._blamed: set[int] = set()
        self._asks_for_kinds = outline.asks_for_kinds

    def replacements(self, edge: Edge) -> list[Repair]:
        """Return the properties that would fit in a pattern instead of its own."""
        context = self._fitting.context(edge)
        return [] if context is None else self._repairs.other_properties(edge, context)

    def findings(self) -> Iterator[Finding]:
        """Yield the faults, one for each pattern.

        Groups in which an earlier query had no fault are passed over: who edits a query, or asks
        many alike, changes little of it at a time.
        """
        parts = (self._fitting, self._repairs, self._blamed)
        constants, data, names = ByConstants(*parts), ByData(*parts), ByNames(*parts)
        terms, words, paths = ByTerms(*parts), ByWords(*parts), ByPaths(*parts)
        sound = self._evidence.sound
        keys = [(hash(context.key), context) for context in self._fitting.contexts]
        left = [(key, context) for key, context in keys if key not in sound]
        for look in (
            self._conflicts, paths.findings, constants.findings, terms.findings, data.findings,
            names.turned, names.unusual, names.better, words.findings, paths.backwards,
        ):  # fmt: skip
            for _, context in left:
                yield from look(context)
        sound.update(
            key
            for key, context in left
            if not any(id(edge) in self._blamed for edge in context.edges)
        )

    def _conflicts(self, context: Context) -> Iterator[Finding]:
        if self._asks_for_kinds:
            return
        left = [
            clash
            for clash in self._fitting.demands.conflicts(context)
            if not self._has_member(clash, context)
        ]
        while left:
            edge = self._culprit(left, context)
            mine = [clash for clash in left if edge in (clash.first.edge, clash.other.edge)]
            left = [clash for clash in left if clash not in mine]
            if id(edge) not in self._blamed:
                self._blamed.add(id(edge))
                yield self._conflict(edge, mine, context)

    def _has_member(self, conflict: Conflict, context: Context) -> bool:
        """Return whether something in the graph is of both kinds all the same."""
        if conflict.is_certain and conflict.first.is_thing != conflict.other.is_thing:
            return False
        first, other = conflict.first, conflict.other
        for demand, given in ((first, other), (other, first)):
            is_type = demand.edge.steps[0].node.value == TYPE and len(demand.edge.steps) == 1
            if is_type and demand.edge.object.kind == "variable" and demand.bits is not None:
                # That it has a type is sure; whether it has one of those below a class is asked.
                return self._evidence.has_kind(given.edge, given.at, demand.bits, self._vocabulary)
        return self._evidence.meet(first.edge, first.at, other.edge, other.at) is True

    def _culprit(self, conflicts: list[Conflict], context: Context) -> Edge:
        """Return the pattern that most conflicts have in common, or that fits its names least."""
        count: dict[int, int] = defaultdict(int)
        edges: dict[int, Edge] = {}
        for conflict in conflicts:
            for demand in (conflict.first, conflict.other):
                count[id(demand.edge)] += 1
                edges[id(demand.edge)] = demand.edge
        return max(edges.values(), key=lambda edge: self._suspicion(edge, count, context))

    def _suspicion(
        self, edge: Edge, count: dict[int, int], context: Context
    ) -> tuple[float, float]:
        changed = reversed_edge(edge) if len(edge.steps) == 1 else None
        mends = (
            changed is not None
            and edge.steps[0].node.value != TYPE
            and not self._fitting.misfits(changed, context)
        )
        doubt = count[id(edge)] + (1.5 if mends else 0.0)
        if len(edge.steps) == 1:
            doubt -= 0.8 * min(self._fitting.merit(edge, context, forgives=True), 2.0)
        return doubt, float(edge.start)

    def _conflict(self, edge: Edge, mine: list[Conflict], context: Context) -> Finding:
        shown = mine[0]
        demand, other = (
            (shown.first, shown.other) if shown.first.edge is edge else (shown.other, shown.first)
        )
        certain = any(clash.is_certain for clash in mine)
        words = self._words(demand, other)
        repairs = self._repairs.of(edge, context)
        rule = "wrong-type"
        if repairs and "direction" in repairs[0].words:
            rule = "reversed"
        node = edge.steps[0].node
        if node.value == TYPE and edge.object.kind == "iri":
            node = edge.object
        severity: Severity = "certain" if certain else "likely"
        return Finding(rule, severity, node.start, node.end, words, tuple(repairs))

    def _words(self, demand: Demand, other: Demand) -> str:
        name = demand.node.value
        who = "what the path reaches" if name.startswith(" ") else f"?{name.partition(' ')[0]}"
        first, second = (demanded(self._vocabulary, given) for given in (demand, other))
        return f"nothing can be {who}: {first}, but {second}"
