"""The facts that a plan starts from, as the graph holds them now."""

from __future__ import annotations

import datetime as dt
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from rtask.errors import TooLargeError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode, Term, moment
from rtask.tasks.actions import ActionClass, Select
from rtask.tasks.patterns import Pattern
from rtask.tasks.planning.problem import Atom

__all__ = ["MAX_FACTS", "Facts", "last_seen", "own_places", "read_facts"]

MAX_FACTS = 200_000
"""Most facts of one predicate."""
_CHUNK = 2000


@dataclass(frozen=True)
class Facts:
    """What holds before a plan.

    Parameters
    ----------
    atoms
        Facts of the predicates that actions and goals use.
    objects
        IRIs of each class of parameters, of those that a fact or a goal mentions.
    """

    atoms: frozenset[Atom]
    objects: Mapping[str, tuple[str, ...]]


def read_facts(
    select: Select,
    actions: Sequence[ActionClass],
    patterns: Sequence[Pattern],
    mentioned: Iterable[str],
) -> Facts:
    """Return the facts of the predicates of actions and of further patterns: one query for each.

    Parameters
    ----------
    patterns
        Those of the goals.
    mentioned
        IRIs that are objects of the problem whether or not a fact mentions them.

    Raises
    ------
    TooLargeError
        A predicate has more than :data:`MAX_FACTS` facts.
    """
    atoms: set[Atom] = set()
    for predicate, query in _queries(actions, patterns).items():
        rows = select(f"{query} LIMIT {MAX_FACTS + 1}")
        if len(rows) > MAX_FACTS:
            raise TooLargeError(f"more than {MAX_FACTS} facts match {predicate}")
        for row in rows:
            values = tuple(_text(term) for term in row)
            if all(values):
                atoms.add((predicate, *values))
    candidates = {value for atom in atoms for value in atom[1:]} | set(mentioned)
    types = sorted({kind for action in actions for _, kind in action.parameters})
    return Facts(frozenset(atoms), _members(select, types, sorted(candidates)))


def _text(term: Term | None) -> str:
    return term.value if isinstance(term, NamedNode) else ""


def _queries(actions: Sequence[ActionClass], patterns: Sequence[Pattern]) -> dict[str, str]:
    """Return the query for the facts of each predicate.

    A pattern that only excludes is asked of all objects of the classes of its parameters.
    """
    queries: dict[str, str] = {}
    kinds: dict[tuple[str, int], set[str]] = defaultdict(set)
    negative: dict[str, Pattern] = {}
    for action in actions:
        classes = dict(action.parameters)
        for pattern in (*action.preconditions, *action.additions, *action.removals):
            if not pattern.is_negative:
                queries.setdefault(pattern.predicate, _query(pattern, ""))
                continue
            negative[pattern.predicate] = pattern
            for number, name in enumerate(pattern.arguments, 1):
                kinds[pattern.predicate, number].add(classes[name])
    for predicate, pattern in negative.items():
        typed = (
            f"VALUES ?k{n} {{ {' '.join(f'<{kind}>' for kind in sorted(kinds[predicate, n]))} }} "
            f"?p{n} a ?k{n} . "
            for n in range(1, len(pattern.arguments) + 1)
        )
        queries[predicate] = _query(pattern, "".join(typed))
    for pattern in patterns:
        queries.setdefault(pattern.predicate, _query(pattern, ""))
    return queries


def _query(pattern: Pattern, before: str) -> str:
    variables = " ".join(f"?p{n}" for n in range(1, len(pattern.arguments) + 1))
    return f"SELECT DISTINCT {variables} WHERE {{ {before}{pattern.sparql} }}"


def _members(
    select: Select, types: Sequence[str], candidates: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    kinds = " ".join(str(NamedNode(kind)) for kind in types)
    members: dict[str, list[str]] = defaultdict(list, {kind: [] for kind in types})
    for part in _chunks(candidates):
        iris = " ".join(str(NamedNode(value)) for value in part)
        query = f"VALUES ?kind {{ {kinds} }} VALUES ?x {{ {iris} }} ?x a ?kind"
        for row in select(f"{PREFIXES}SELECT DISTINCT ?kind ?x WHERE {{ {query} }}"):
            members[str(row.value("kind"))].append(str(row.value("x")))
    return {kind: tuple(sorted(set(values))) for kind, values in members.items()}


def _chunks(values: Sequence[str]) -> Iterator[Sequence[str]]:
    for at in range(0, len(values), _CHUNK):
        yield values[at : at + _CHUNK]


def own_places(
    select: Select, robots: Iterable[str], places: Iterable[str]
) -> Iterator[tuple[str, str]]:
    """Yield each robot with the places that it described itself: those that it stands at."""
    for part in _chunks(sorted(places)):
        given = " ".join(str(NamedNode(place)) for place in part)
        owners = " ".join(str(NamedNode(robot)) for robot in sorted(robots))
        rows = select(
            f"{PREFIXES}SELECT DISTINCT ?robot ?place WHERE {{ VALUES ?robot {{ {owners} }} "
            f"VALUES ?place {{ {given} }} ?graph rt:graphOwner ?robot "
            "GRAPH ?graph { ?place a ?kind } }"
        )
        for row in rows:
            yield str(row.value("robot")), str(row.value("place"))


def last_seen(select: Select, exemplars: Iterable[str]) -> dict[str, dt.datetime]:
    """Return when each thing was last seen where it is; none of what is only stated to be there."""
    seen: dict[str, dt.datetime] = {}
    for part in _chunks(sorted(set(exemplars))):
        iris = " ".join(str(NamedNode(value)) for value in part)
        rows = select(
            f"{PREFIXES}SELECT ?x ?when WHERE {{ VALUES ?x {{ {iris} }} "
            "?x rt:currentPlacement ?stay . { ?stay rt:confirmedAt ?when } UNION { "
            "?stay rt:placementPose ?pose ; time:hasBeginning/time:inXSDDateTimeStamp ?when } }"
        )
        for row in rows:
            exemplar, when = str(row.value("x")), moment(str(row.value("when")))
            seen[exemplar] = max(when, seen.get(exemplar, when))
    return seen
