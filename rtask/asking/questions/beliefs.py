"""What the graph has come to believe: an earlier state and a later one, compared belief by belief.

A commit says which statements were written; a belief is what follows from all of them, such as that
one end of a carton is weak with a chance of .4, or that a grasp holds.
"""

from __future__ import annotations

import datetime as dt
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any

import ontology
from rtask.asking.questions.mentions import Select
from rtask.asking.questions.periods import Period
from rtask.errors import BusyError, TooLargeError
from rtask.rdf.terms import Literal, NamedNode
from rtask.sparql.results import Solutions

__all__ = [
    "BELIEFS", "ChangedBeliefs", "Past", "asks_for_changes", "changed_beliefs", "past_states",
]  # fmt: skip

Past = Callable[[dt.datetime], AbstractContextManager[Select]]
"""Opens the state of the graph at a time."""

MAX_UNDONE = 200_000
"""Statements that may have changed since an earlier state that is compared."""
_WAIT_S = 5.0
_COMPARING = threading.Lock()
_ASKED = re.compile(
    r"\W*(?:what(?:'s|’s| is| has| have)?|which beliefs(?: have)?)(?: been)?"
    r" (?:changed|new|different)(?: (?:in|here|since|the|graph))*\W*",
    re.I,
)
_OPEN_END = re.compile(r"\bsince\s*$", re.I)
_DAY = dt.timedelta(days=1)

_CAUSES = """?about rt:causeProbability ?number .
    ?hiding rt:hasHiddenCause ?about ; rt:name ?name
    OPTIONAL { ?about rt:zoneKind/rdfs:label ?zone }
    OPTIONAL { ?about rt:zoneStart ?start ; rt:zoneEnd ?end }
    OPTIONAL { ?about rt:centreAlongX ?centre ; rt:centreOfMassSigma ?sigma }
    BIND(CONCAT(?name, IF(BOUND(?centre), " has its weight",
      CONCAT(" is ", STR(COALESCE(?zone, "weak")))), " from ",
      STR(xsd:integer(ROUND(1000 * COALESCE(?start, ?centre - ?sigma)))), " to ",
      STR(xsd:integer(ROUND(1000 * COALESCE(?end, ?centre + ?sigma)))), " mm") AS ?belief)
    BIND(CONCAT(STR(xsd:integer(ROUND(100 * ?number))), " %") AS ?value) BIND("cause" AS ?kind)"""
_GRASPS = """?hiding rt:hasGrasp ?about ; rt:name ?name .
    ?about rt:hasEvaluation ?latest . ?latest rt:beliefAlpha ?alpha ; rt:graspConfidence ?number ;
      prov:generatedAtTime ?time
    FILTER NOT EXISTS { ?hiding rt:exemplarOf ?product }
    FILTER NOT EXISTS { ?about rt:hasEvaluation ?later . ?later rt:beliefAlpha ?other ;
      prov:generatedAtTime ?newer FILTER(?newer > ?time) }
    BIND(CONCAT("grasp ", REPLACE(STR(?about), "^.*/", ""), " of ", ?name, " holds") AS ?belief)
    BIND(CONCAT(STR(xsd:integer(ROUND(100 * ?number))), " %") AS ?value) BIND("grasp" AS ?kind)"""
_PLACES = """?about rt:exemplarOf/rt:name ?name ; rt:currentPlacement ?placement .
    ?placement rt:placedIn|rt:placedOn|rt:heldBy ?there . ?there rt:name ?value
    BIND(CONCAT("a ", ?name, " is in or on") AS ?belief) BIND("place" AS ?kind)"""
_NAMES = """?about a rt:ManipulableObject ; rt:objectId ?id ; rt:name ?value
    BIND(CONCAT("object ", REPLACE(STR(?about), "^.*/", ""), " is called") AS ?belief)
    BIND("name" AS ?kind)"""

BELIEFS = (
    "\n".join(
        f"PREFIX {name}: <{ontology.PREFIXES[name]}>" for name in ("prov", "rdfs", "rt", "xsd")
    )
    + "\n\nSELECT DISTINCT ?about ?kind ?belief ?value\nWHERE {\n"
    + "\n  UNION\n".join(f"  {{ {part} }}" for part in (_CAUSES, _GRASPS, _PLACES, _NAMES))
    + "\n}\nORDER BY ?about ?kind ?belief ?value\n"
)
"""The beliefs of a state: what each is about, its words, and its chance or place."""

_COLUMNS = ("about", "kind", "belief", "value")
_ORDER = ("cause", "grasp", "place", "name")
_Beliefs = Mapping[tuple[str, str], tuple[str, str]]


@dataclass(frozen=True)
class ChangedBeliefs:
    """Beliefs that differ between two states.

    Parameters
    ----------
    period
        Words for it.
    rows
        ``about``, ``belief``, ``before`` and ``now``; one of the last two is unbound where the
        belief was not held.
    clauses
        Each row in words.
    """

    period: str
    rows: Solutions
    clauses: tuple[str, ...]


def asks_for_changes(text: str, period: Period | None) -> bool:
    """Whether a text asks what has changed, and nothing more particular.

    >>> asks_for_changes("What has changed?", None), asks_for_changes("what changed hands?", None)
    (True, False)
    """
    plain = text.replace(period.text, " ") if period is not None else text
    return _ASKED.fullmatch(plain) is not None


@contextmanager
def _past_state(kb: Any, time: dt.datetime, timeout_s: float) -> Iterator[Select]:
    """Open the state of a graph at a time, one at a time in this process."""
    if not _COMPARING.acquire(timeout=_WAIT_S):
        raise BusyError("another earlier state is being compared; try again")
    try:
        open_state = kb.as_of  # refused first by graphs that keep no earlier states
        seq = kb.commit_at(time)
        undone = kb.changed_since(seq)
        if undone > MAX_UNDONE:
            raise TooLargeError(
                f"{undone} statements have changed since {time.isoformat()}, and a question undoes "
                f"{MAX_UNDONE}; ask about a shorter time",
                limit=MAX_UNDONE,
            )
        with open_state(seq) as past:
            yield lambda query: past.select(query, timeout_s=timeout_s)
    finally:
        _COMPARING.release()


def past_states(kb: Any, timeout_s: float) -> Past:
    """Return what opens earlier states of a graph, which keeps a journal in this process.

    Each of their queries has a time limit of ``timeout_s``.
    """

    def open_state(time: dt.datetime) -> AbstractContextManager[Select]:
        return _past_state(kb, time, timeout_s)

    return open_state


def changed_beliefs(
    select: Select, past: Past, text: str, period: Period | None, now: dt.datetime
) -> ChangedBeliefs:
    """Return the beliefs that changed in a period; by default in the last day.

    Parameters
    ----------
    select
        Evaluates a query now.
    past
        Opens earlier states.

    Raises
    ------
    UnsupportedError, GoneError, TooLargeError, BusyError
        The earlier state cannot be read.
    QueryTimeout
        A query took too long.
    """
    start = now - _DAY if period is None or period.start is None else period.start
    end = None if period is None else period.end
    words = "in the last 24 hours" if period is None else period.text
    if period is not None and _OPEN_END.search(text[: text.find(period.text)]):
        end, words = None, f"since {words}"  # "since yesterday" goes on until now
    with past(start) as before:
        old = _beliefs(before)
    if end is not None and end < now:
        with past(end) as then:
            new = _beliefs(then)
    else:
        new = _beliefs(select)
    return _difference(words, old, new)


def _beliefs(select: Select) -> _Beliefs:
    result: dict[tuple[str, str], tuple[str, str]] = {}
    for row in select(BELIEFS):
        about, kind, belief, value = (str(row.value(name)) for name in _COLUMNS)
        result[about, kind] = belief, value
    return result


def _difference(words: str, old: _Beliefs, new: _Beliefs) -> ChangedBeliefs:
    rows: list[tuple[Any, ...]] = []
    clauses = []
    for key in sorted({*old, *new}, key=lambda key: (_ORDER.index(key[1]), key)):
        if old.get(key) == new.get(key):
            continue
        (belief, now), (was, before) = new.get(key, ("", "")), old.get(key, ("", ""))
        words_of = belief or was
        cells = (words_of, before, now)
        rows.append((NamedNode(key[0]), *(Literal(cell) if cell else None for cell in cells)))
        if not was:
            clauses.append(f"{words_of}: {now}, which is new")
        elif not belief:
            clauses.append(f"{words_of}: no longer believed (it was {before})")
        else:
            clauses.append(f"{words_of}: {before} before, {now} now")
    columns = ("about", "belief", "before", "now")
    return ChangedBeliefs(words, Solutions(columns, rows), tuple(clauses))
