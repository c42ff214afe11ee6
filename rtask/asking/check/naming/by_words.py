"""Patterns that contradict the plain words of a variable: ``?when``, ``?width``, ``?parent``."""

from __future__ import annotations

from collections.abc import Iterator

from rtask.asking.check.by_data import is_chained
from rtask.asking.check.findings import Finding
from rtask.asking.check.fitting import is_same_variable, reversed_edge
from rtask.asking.check.look import Look
from rtask.asking.check.naming.meanings import (
    head_of,
    is_identifying,
    is_of_stacks,
    is_process_named,
    kinds_of_word,
    literals_by_word,
    physical_words,
    rank_of,
    rank_of_values,
)
from rtask.asking.check.naming.usual import kinds_by_name
from rtask.asking.check.syntax.outline import Edge
from rtask.asking.check.types import TYPE, Context, Demand, family
from rtask.asking.check.vocabulary import local
from rtask.asking.check.wording import demanded

__all__ = ["ByWords"]


class ByWords(Look):
    """Looks for variables whose last word says that they are something else."""

    def findings(self, context: Context) -> Iterator[Finding]:
        """Yield the patterns of a context that the words of its variables contradict."""
        for edge in context.own:
            if id(edge) in self._blamed or len(edge.steps) != 1:
                continue
            if self._is_upside_down(edge, context):
                self._blamed.add(id(edge))
                yield self._turned(edge)
        for edge in self._patterns(context):
            for demand in self._fitting.demands.of(edge, context) or ():
                if demand.node.kind == "variable" and self._is_odd(demand, edge, context):
                    self._blamed.add(id(edge))
                    yield self._odd(demand, edge, context)
                    break

    def _is_upside_down(self, edge: Edge, context: Context) -> bool:
        """Return whether a pattern leads from what is named as the whole to the part."""
        (step,) = edge.steps
        about, value = edge.ends[:: -1 if step.is_inverse else 1]
        if about.kind != "variable" or value.kind != "variable":
            return False
        upwards = rank_of_values(step.node.value)
        if edge.repeats and "step" in (head_of(about.name), head_of(value.name)):
            return False  # a step of the path, whichever way it goes
        # That a root has no parent is asked with the root as subject.
        is_stack = is_of_stacks(step.node.value)
        of_subject = rank_of(about.name, is_value=upwards < 0, is_stack=is_stack)
        of_value = rank_of(value.name, is_value=upwards > 0, is_stack=is_stack)
        ranks = of_value * upwards, 0 if context.is_tested else of_subject * -upwards
        if max(ranks) > 0 or min(ranks) == 0 or is_chained(edge, context):
            return False
        ranked = [node for node, rank in ((about, of_subject), (value, of_value)) if rank]
        if any(
            self._is_of_its_name(demand)
            for demand in self._fitting.demands.of(edge, context) or ()
            if any(is_same_variable(demand.node, node) for node in ranked)
        ):
            return False
        return not self._fitting.misfits(reversed_edge(edge), context)

    def _is_of_its_name(self, demand: Demand) -> bool:
        """Return whether a variable is called like its class: ``?place`` for the task to place."""
        named = kinds_by_name(self._vocabulary).get(demand.node.name.lower(), 0)
        return bool(named & (demand.bits or 0)) or self._is_named_after_matches(demand)

    def _turned(self, edge: Edge) -> Finding:
        node = edge.steps[0].node
        words = (
            f"?{edge.subject.value} and ?{edge.object.value} are named the other way round than "
            f"{local(node.value)} leads"
        )
        return Finding(
            "reversed", "likely", node.start, node.end, words, (self._repairs.turned(edge),)
        )

    def _is_odd(self, demand: Demand, edge: Edge, context: Context) -> bool:
        """Return whether the last word of a variable is that of something else."""
        iri = edge.steps[0].node.value
        word = head_of(demand.node.name)
        if not word or demand.is_observed or demand.is_of_terms:
            return False
        if self._is_named_after(demand, edge) or self._is_named_after_matches(demand):
            return False
        if is_process_named(demand.node.name, demand.bits, self._vocabulary):
            return False
        if self._is_agreed(demand, edge, context) or self._is_explained(demand, edge, context):
            return False
        if iri == TYPE and edge.object.kind != "iri":
            return False
        literals = literals_by_word(self._vocabulary).get(word)
        if demand.is_thing:
            if literals is None:
                return self._is_foreign(demand, edge, word, context)
            if demand.at == 0 and not edge.steps[0].is_inverse:
                return False  # that something is said of it shows that no literal is meant
            return word in ("name", "label") or not self._fitting.is_attested(edge, context)
        if demand.is_thing is None:
            return False
        kinds = {family(kind) for kind in demand.datatypes}
        kinds = {"dateTime" if kind.startswith("dateTime") else kind for kind in kinds}
        if literals is not None:
            return bool(kinds) and "" not in kinds and not kinds & literals
        if word not in physical_words(self._vocabulary) or is_identifying(iri):
            return False
        return not self._is_borne_out(demand, edge, kinds_of_word(word, self._vocabulary), context)

    def _is_foreign(self, demand: Demand, edge: Edge, word: str, context: Context) -> bool:
        """Return whether the classes that are called by a word are quite other ones."""
        kinds = kinds_of_word(word, self._vocabulary)
        if not kinds or demand.bits is None or demand.bits & kinds:
            return False
        if not self._vocabulary.are_unlike(demand.bits, kinds):
            return False
        return not self._is_borne_out(demand, edge, kinds, context)

    def _is_borne_out(self, demand: Demand, edge: Edge, kinds: int, context: Context) -> bool:
        """Return whether the graph has what a pattern says, or nothing that would suit better.

        That a graph has no such statements is no fault.
        """
        if edge.steps[0].node.value == TYPE:
            # That there are named graphs does not say that what is called a robot is one; but a
            # task and an action are both processes, and called by each other's names.
            sorts = [self._vocabulary.sorts(bits) for bits in (demand.bits or 0, kinds)]
            if "Process" in sorts[0] & sorts[1]:
                return True
            is_other = all(sorts) and not sorts[0] & sorts[1]
            if is_other or not self._evidence.matches(edge):
                return self._fitting.is_attested(edge, context)
            return not self._fitting.is_contradicted(edge, context)
        if self._fitting.evidence.matches(edge):
            return not self._fitting.is_contradicted(edge, context)
        named = Edge(demand.node, [], demand.node, -1, -1)
        wish = Demand(named, 0, kinds or None, True)
        return not self._repairs.has_attested(edge, context, wish)

    def _is_agreed(self, demand: Demand, edge: Edge, context: Context) -> bool:
        """Return whether another pattern makes the same of a variable: that is what is meant."""
        for other in context.touching(edge):
            if other is edge:
                continue
            for given in self._fitting.demands.of(other, context) or ():
                if not is_same_variable(given.node, demand.node):
                    continue
                if given.is_thing != demand.is_thing or given.is_observed:
                    continue
                if not demand.is_thing or (
                    given.bits is not None and (demand.bits is None or given.bits & demand.bits)
                ):
                    return True
        return False

    def _odd(self, demand: Demand, edge: Edge, context: Context) -> Finding:
        (step,) = edge.steps
        node = edge.object if step.node.value == TYPE else step.node
        words = (
            f"{demanded(self._vocabulary, demand)}, "
            f"which is hardly what ?{demand.node.value.partition(' ')[0]} stands for"
        )
        usual = kinds_of_word(head_of(demand.node.name), self._vocabulary)
        repairs = self._repairs.of_named(edge, demand, usual, context)
        return Finding("unusual-name", "likely", node.start, node.end, words, tuple(repairs))
