"""Goals: a pattern that is to hold, for everything that a second pattern selects."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rtask.errors import TooLargeError, UsageError
from rtask.rdf.namespaces import PREFIXES
from rtask.rdf.terms import NamedNode
from rtask.tasks.actions import Select
from rtask.tasks.limits import Limits
from rtask.tasks.patterns import Pattern, expanded, parse_pattern
from rtask.tasks.planning.problem import Atom, Goal

__all__ = [
    "LOCATED", "MAX_GOALS", "MAX_JSON", "MAX_TEXT", "NO_LIMITS", "Aim", "Target", "goal_text",
    "read_aims", "settled_goal", "targets",
]  # fmt: skip

MAX_AIMS = 50
"""Most goals of one JSON object."""
MAX_GOALS = 2000
"""Most things of one goal."""
MAX_ROWS = 20_000
MAX_TEXT = 1000
"""Most characters of a goal in words."""
MAX_JSON = 20_000
"""Most characters of a goal in JSON."""
NO_LIMITS = Limits()
LOCATED = "?thing rt:locatedOn ?place"
_WHERE = re.compile(r"\bwhere\b\s*\{(.*)\}\s*$", re.I | re.S)
_SUBJECT = re.compile(r"\?(\w+)")


@dataclass(frozen=True)
class Aim:
    """A goal as it was understood.

    Parameters
    ----------
    pattern
        The graph pattern that is to match.
    where
        What selects its variables, in SPARQL; empty for a pattern without variables.
    number
        For how many things; None for all.
    text
        The goal for people.
    stage
        Goals of a later stage are begun once those of all earlier ones are reached.
    others
        Only about things that no other goal has taken: the rest.
    end
        Of words that speak of the world as it is when they are said: what selects ``?place``
        alone; empty where things and places belong together. None where the words still say the
        same once a part of it is done.
    """

    pattern: str
    where: str
    number: int | None = None
    text: str = ""
    stage: int = 0
    others: bool = False
    end: str | None = None

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the variables of the pattern; the first stands for what the goal is about."""
        return tuple(dict.fromkeys(_SUBJECT.findall(self.pattern)))

    @property
    def sparql(self) -> str:
        """The query for what the goal is about, and for what would do."""
        names = " ".join(f"?{name}" for name in self.variables)
        # On a line of its own, so that no comment at the end hides what follows.
        return f"SELECT DISTINCT {names} WHERE {{ {self.where.strip()}\n}}"


@dataclass(frozen=True)
class Target:
    """One thing of a goal, and the facts of which any would do."""

    aim: Aim
    subject: str
    goal: Goal


def read_aims(given: str | Mapping[str, Any]) -> tuple[Aim, ...] | None:
    """Return the goals of a pattern or of JSON; None for words.

    Parameters
    ----------
    given
        ``PATTERN [WHERE { SPARQL }]``, or an object, or its JSON, with ``achieve``, and if need be
        ``where`` and ``number``; ``goals`` has several of these, and one with ``then`` true is
        begun once those before it are reached, one with ``others`` true is about things alone that
        no goal before it has taken. ``text`` is the goal for people; limits such as ``by``
        are read by :func:`~rtask.tasks.limits.read_limits`.

    Raises
    ------
    UsageError
        An object without ``achieve``, or with members of other types.
    DataError
        A pattern cannot be read.

    Examples
    --------
    >>> read_aims("?x rt:locatedOn <urn:box> WHERE { ?x a rt:Exemplar }")[0].variables
    ('x',)
    """
    if isinstance(given, str) and given.lstrip().startswith("{"):
        try:
            given = json.loads(given)
        except json.JSONDecodeError as error:
            raise UsageError(f"the goal is not JSON: {error}") from error
        if not isinstance(given, Mapping):
            raise UsageError("a goal in JSON is an object")
    if isinstance(given, Mapping):
        parts = given.get("goals", [given])
        if not isinstance(parts, Sequence) or isinstance(parts, str) or not parts:
            raise UsageError("goals is a list of goals")
        if len(parts) > MAX_AIMS:
            raise UsageError(f"at most {MAX_AIMS} goals at once, not {len(parts)}")
        aims, stage = [], 0
        for part in parts:
            aim, is_later = _from_object(part)
            stage += is_later
            aims.append(replace(aim, stage=stage))
        return tuple(aims)
    if not re.match(r"\s*(?:\?\w|<|\w+:\w)", given):
        return None
    match = _WHERE.search(given)
    pattern = given[: match.start()] if match else given
    return (_checked(pattern, match[1] if match else "", None),)


def goal_text(given: str | Mapping[str, Any]) -> str:
    """Return a goal for people: its words, where JSON that was made of words has them.

    Examples
    --------
    >>> goal_text('{"goals": [], "text": "half of the cups onto the shelf"}')
    'half of the cups onto the shelf'
    """
    if isinstance(given, str):
        if not given.lstrip().startswith("{"):
            return given
        try:
            parsed = json.loads(given)
        except json.JSONDecodeError:
            return given
    else:
        parsed, given = given, json.dumps(dict(given))
    text = parsed.get("text") if isinstance(parsed, Mapping) else None
    return text[:MAX_TEXT] if isinstance(text, str) and text.strip() else given


def settled_goal(
    text: str, matches: Sequence[Target], aims: Sequence[Aim], limits: Limits = NO_LIMITS
) -> str:
    """Return a goal in words as JSON with the things that its words mean now.

    Once one of two pens from the table is in the box, "a pen from the table" would be the other.
    What may not be touched is settled in any case: whatever helps the goal keeps to it, too.

    Returns
    -------
    JSON
        Empty where the words will say the same, or where it would be too long.
    """
    if all(aim.end is None for aim in aims) and not limits.of_help:
        return ""
    of_aim: dict[Aim, list[Target]] = defaultdict(list)
    for target in matches:
        of_aim[target.aim].append(target)
    goals: list[dict[str, Any]] = []
    stage = 0
    for aim in aims:
        where = aim.where if aim.end is None else _settled(of_aim[aim], aim.end)
        goals.append(
            {"achieve": aim.pattern, "where": where, "number": aim.number,
             "then": aim.stage > stage, "others": aim.others, "text": aim.text}
        )  # fmt: skip
        stage = aim.stage
    settled = json.dumps({"goals": goals, "text": text, **limits.to_dict()})
    return settled if len(settled) <= MAX_JSON else ""


def _settled(matches: Sequence[Target], end: str) -> str:
    """Return what selects the things of a goal, also once they are known to be others."""
    of = "?was rt:mergedInto* ?thing FILTER NOT EXISTS { ?thing rt:mergedInto ?into }"
    if end:
        things = " ".join(f"<{target.subject}>" for target in matches)
        return f"VALUES ?was {{ {things} }} {of} {end}"
    rows = " ".join(f"(<{t.subject}> <{atom[-1]}>)" for t in matches for atom in t.goal)
    return f"VALUES (?was ?place) {{ {rows} }} {of}"


def _from_object(part: object) -> tuple[Aim, bool]:
    """Return a goal, and whether it is to wait for those before it."""
    if not isinstance(part, Mapping) or not isinstance(part.get("achieve"), str):
        raise UsageError('a goal has "achieve", a graph pattern such as "?x rt:locatedOn <IRI>"')
    where, number = part.get("where", ""), part.get("number")
    if not isinstance(where, str):
        raise UsageError('"where" of a goal is SPARQL text')
    if number is not None and (not isinstance(number, int) or isinstance(number, bool)):
        raise UsageError('"number" of a goal is an integer, or null for all')
    if number is not None and number < 1:
        raise UsageError(f'"number" of a goal is 1 or more, not {number}')
    then = part.get("then", False)
    if not isinstance(then, bool):
        raise UsageError('"then" of a goal is true or false')
    others = part.get("others", False)
    if not isinstance(others, bool):
        raise UsageError('"others" of a goal is true or false')
    text = part.get("text", "")
    if not isinstance(text, str) or len(text) > MAX_TEXT:
        raise UsageError(f'"text" of a goal is a text of at most {MAX_TEXT} characters')
    aim = _checked(part["achieve"], where, number)
    return replace(aim, others=others, text=text or aim.text), then


def _checked(pattern: str, where: str, number: int | None) -> Aim:
    pattern = " ".join(pattern.split())
    expanded(pattern)
    aim = Aim(pattern, where, number, pattern)
    if aim.variables and not where.strip():
        names = ", ".join(f"?{name}" for name in aim.variables)
        raise UsageError(f"nothing selects {names}: add WHERE {{ ... }} to the goal {pattern!r}")
    return aim


def targets(select: Select, aim: Aim) -> tuple[Pattern, list[Target]]:
    """Return the predicate of a goal, and each thing that it is about.

    Raises
    ------
    TooLargeError
        The goal is about more than :data:`MAX_GOALS` things.
    """
    if not aim.variables:
        return _constant(aim)
    pattern = parse_pattern(aim.pattern, aim.variables)
    by_subject: dict[str, list[Atom]] = defaultdict(list)
    rows = select(f"{PREFIXES}{aim.sparql} LIMIT {MAX_ROWS + 1}")
    if len(rows) > MAX_ROWS:
        raise TooLargeError(f"more than {MAX_ROWS} ways to reach the goal {aim.text!r}")
    for row in rows:
        values = {name: row[name] for name in aim.variables}
        if all(isinstance(value, NamedNode) for value in values.values()):
            iris = {name: str(row.value(name)) for name in aim.variables}
            atom = (pattern.predicate, *(iris[name] for name in pattern.arguments))
            by_subject[iris[aim.variables[0]]].append(atom)
    if len(by_subject) > MAX_GOALS:
        raise TooLargeError(f"the goal is about {len(by_subject)} things; at most {MAX_GOALS}")
    return pattern, [
        Target(aim, subject, tuple(sorted(set(atoms))))
        for subject, atoms in sorted(by_subject.items())
    ]


def _constant(aim: Aim) -> tuple[Pattern, list[Target]]:
    """Return a goal whose subject and object are IRIs, as a predicate over both."""
    words = expanded(aim.pattern).rstrip(" .").split()
    if len(words) != 3 or not all(word.startswith("<") for word in words):
        raise UsageError(f"the goal {aim.pattern!r} is no statement about two IRIs")
    subject, prop, value = words
    pattern = parse_pattern(f"?s {prop} ?o", ("s", "o"))
    atom = (pattern.predicate, subject.strip("<>"), value.strip("<>"))
    return pattern, [Target(aim, atom[1], (atom,))]
