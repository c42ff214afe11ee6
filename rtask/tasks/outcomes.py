"""How tasks ended so far: the chance of success and the duration of a planned step."""

from __future__ import annotations

import datetime as dt
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rtask.rdf.namespaces import PREFIXES, values
from rtask.rdf.terms import literal
from rtask.tasks.actions import ActionClass, Select

__all__ = ["Counts", "Evidence", "Experience", "read_experience"]

_PRIOR = 2.0
"""Weight, in attempts, of what is known of all hands and products about one hand and product."""
_MAX_INTERVALS = 10_000
_OUTCOMES = """
SELECT ?action ?hand ?product ?ok (COUNT(DISTINCT ?outcome) AS ?n) WHERE {
  VALUES ?action { %s }
  ?task a ?action ; rt:carriedOutBy ?attempt .
  ?attempt rt:hasOutcome ?outcome .
  ?outcome rt:judgedSuccess ?ok
  OPTIONAL { ?attempt rt:activates/rt:gripperType ?hand }
  OPTIONAL { ?task rt:handles ?product }
} GROUP BY ?action ?hand ?product ?ok"""
_BEHIND = """
# The tasks of one kind that were judged; those of the same kind of hand and product first.
SELECT ?robot ?attempt ?succeeded ?hand ?product WHERE {
  ?task a <%s> ; rt:carriedOutBy ?attempt .
  ?attempt rt:hasOutcome ?outcome ; rt:performedBy ?robot .
  ?outcome rt:judgedSuccess ?succeeded
  OPTIONAL { ?attempt rt:activates/rt:gripperType ?hand }
  OPTIONAL { ?task rt:handles ?product }
} ORDER BY DESC(COALESCE(STR(?hand) = %s && STR(?product) = %s, false)) ?robot ?attempt"""
_DURATIONS = """
SELECT ?action ?begin ?end WHERE {
  VALUES ?action { %s }
  ?task a ?action ; rt:executedIn ?interval .
  ?interval time:hasBeginning/time:inXSDDateTimeStamp ?begin ;
    time:hasEnd/time:inXSDDateTimeStamp ?end
} LIMIT %d"""
_KINDS = """
SELECT ?part ?kind WHERE {
  { ?part rt:gripperType ?kind } UNION { ?part rt:exemplarOf ?kind }
}"""


@dataclass
class Counts:
    """Attempts and successes."""

    successes: int = 0
    attempts: int = 0

    def add(self, is_success: bool, number: int) -> None:
        """Count attempts that all ended alike."""
        self.attempts += number
        self.successes += number if is_success else 0


@dataclass(frozen=True)
class Evidence:
    """What the chance of a step rests on.

    Parameters
    ----------
    text
        In words.
    query
        SPARQL for the outcomes, with their robots.
    """

    text: str
    query: str


@dataclass(frozen=True)
class Experience:
    """Outcomes and durations of tasks, by their class.

    The chance of a step is the mean of a beta distribution: the outcomes of this kind of hand with
    this product, with those of the class as a prior that weighs two attempts. Without outcomes of
    the class the chance is not known, and counts as one half.
    """

    kinds: Mapping[str, str] = field(default_factory=dict)
    by_class: Mapping[str, Counts] = field(default_factory=dict)
    by_pair: Mapping[tuple[str, str, str], Counts] = field(default_factory=dict)
    durations_s: Mapping[str, float] = field(default_factory=dict)

    def counts(self, action: ActionClass, arguments: Mapping[str, str]) -> Counts:
        """Return the outcomes of this kind of hand with this product."""
        return self.by_pair.get((action.iri, *self._pair(action, arguments)), Counts())

    def _pair(self, action: ActionClass, arguments: Mapping[str, str]) -> tuple[str, str]:
        """Return the type of the hand and the product; empty where there is none."""
        names = (action.parameter("engages"), action.parameter("handlesExemplar"))
        hand, product = (self.kinds.get(arguments.get(name, ""), "") for name in names)
        return hand, product

    def chance(self, action: ActionClass, arguments: Mapping[str, str]) -> float:
        """Return the chance of success, 0..1."""
        overall = self.by_class.get(action.iri, Counts())
        prior = (overall.successes + 1) / (overall.attempts + 2)
        counts = self.counts(action, arguments)
        return (counts.successes + _PRIOR * prior) / (counts.attempts + _PRIOR)

    def evidence(
        self, action: ActionClass, arguments: Mapping[str, str], name: Callable[[str], str]
    ) -> Evidence:
        """Return what the chance rests on.

        Parameters
        ----------
        name
            Returns the name of a product.
        """
        hand, product = self._pair(action, arguments)
        overall, counts = self.by_class.get(action.iri, Counts()), self.counts(action, arguments)
        query = _BEHIND % (action.iri, literal(hand), literal(product))
        subject = " with ".join(part for part in (hand, product and name(product)) if part)
        text = f"{_in_words(overall, counts, subject)}; {self._duration_in_words(action)}"
        return Evidence(text, PREFIXES + query.lstrip())

    def duration_s(self, action: ActionClass) -> float:
        """Return the mean duration of tasks of the class, else what its description says."""
        return self.durations_s.get(action.iri, action.duration_s)

    def _duration_in_words(self, action: ActionClass) -> str:
        duration = f"{self.duration_s(action):.0f} s"
        if action.iri in self.durations_s:
            return f"{duration} is the mean of such tasks so far"
        return f"{duration} is " + (
            "what is stated of such tasks" if action.is_duration_stated
            else "assumed, as nobody has stated rt:usualDuration of such tasks"
        )  # fmt: skip

    def estimate(self, action: ActionClass) -> Callable[[Mapping[str, str]], tuple[float, float]]:
        """Return what estimates duration, s, and chance of a step."""
        duration_s = self.duration_s(action)
        chances: dict[tuple[str, str], float] = {}
        names = action.parameter("engages"), action.parameter("handlesExemplar")

        def of(arguments: Mapping[str, str]) -> tuple[float, float]:
            key = (
                self.kinds.get(arguments.get(names[0], ""), ""),
                self.kinds.get(arguments.get(names[1], ""), ""),
            )
            if key not in chances:
                chances[key] = self.chance(action, arguments)
            return duration_s, chances[key]

        return of


def _in_words(overall: Counts, counts: Counts, subject: str) -> str:
    """Say what a chance rests on.

    Parameters
    ----------
    subject
        The kind of hand and the product; empty where a task has neither.

    Examples
    --------
    >>> _in_words(Counts(10, 14), Counts(3, 4), "nao_hand with cup")
    'nao_hand with cup: 3 of 4 succeeded; of all tasks of this kind 10 of 14, weighed as 2 attempts'
    >>> _in_words(Counts(), Counts(), "nao_hand with cup")
    'no task of this kind was judged yet, so that it is taken for even'
    """
    if not overall.attempts:
        return "no task of this kind was judged yet, so that it is taken for even"
    own = f"{counts.successes} of {counts.attempts} succeeded" if counts.attempts else "untried"
    every = f"of all tasks of this kind {overall.successes} of {overall.attempts}"
    return f"{subject or 'this'}: {own}; {every}, weighed as {_PRIOR:.0f} attempts"


def read_experience(select: Select, actions: Sequence[ActionClass]) -> Experience:
    """Return the outcomes and durations of tasks of these classes."""
    classes = values(action.iri for action in actions)
    by_class: dict[str, Counts] = defaultdict(Counts)
    by_pair: dict[tuple[str, str, str], Counts] = defaultdict(Counts)
    for row in select(PREFIXES + _OUTCOMES % classes):
        action, number = str(row.value("action")), int(str(row.value("n")))
        is_success = row.value("ok") is True
        pair = (action, str(row.value("hand") or ""), str(row.value("product") or ""))
        by_class[action].add(is_success, number)
        by_pair[pair].add(is_success, number)
    rows = select(PREFIXES + _KINDS)
    kinds = {str(row.value("part")): str(row.value("kind")) for row in rows}
    return Experience(kinds, dict(by_class), dict(by_pair), _durations(select, classes))


def _durations(select: Select, classes: str) -> dict[str, float]:
    spans: dict[str, list[float]] = defaultdict(list)
    for row in select(PREFIXES + _DURATIONS % (classes, _MAX_INTERVALS)):
        begin, end = (dt.datetime.fromisoformat(str(row.value(name))) for name in ("begin", "end"))
        spans[str(row.value("action"))].append((end - begin).total_seconds())
    return {action: sum(parts) / len(parts) for action, parts in spans.items()}
