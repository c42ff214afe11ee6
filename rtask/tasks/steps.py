"""Steps of a plan with their reasons, their words, and when they can begin."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rtask.rdf.namespaces import RT, local_name
from rtask.tasks.actions import ActionClass
from rtask.tasks.outcomes import Experience
from rtask.tasks.patterns import Pattern
from rtask.tasks.plan import PlannedStep, Support
from rtask.tasks.planning.problem import Atom, Problem, Step

__all__ = ["Wording", "excluded_by", "excluded_link", "planned_steps", "statement_of",
           "with_ages"]  # fmt: skip


def statement_of(atom: Atom) -> tuple[str, str, str] | None:
    """Return the statement of a fact; None if it is no single one."""
    arguments = tuple(f"a{n}" for n in range(1, len(atom)))
    return Pattern(atom[0], arguments).triple(atom[1:])


_EXCLUDED = re.compile(r"FILTER NOT EXISTS { \?1 (?:a|<[^<>]*#type>) <([^<>]*)> }")
_EXCLUDED_LINK = re.compile(r"FILTER NOT EXISTS { \?1 <([^<>]*)> \?2 }")


def excluded_by(atom: Atom) -> tuple[str, str] | None:
    """Return what a fact says that something is not: its IRI and the class; None if no such fact.

    >>> excluded_by(("FILTER NOT EXISTS { ?1 a <urn:Shut> }", "urn:box"))
    ('urn:box', 'urn:Shut')
    """
    match = _EXCLUDED.fullmatch(atom[0])
    return (atom[1], match[1]) if match is not None else None


def excluded_link(atom: Atom) -> tuple[str, str, str] | None:
    """Return the statement that a fact says is not made about two things; None if no such fact.

    >>> excluded_link(("FILTER NOT EXISTS { ?1 <urn:p> ?2 }", "urn:box", "urn:hand"))
    ('urn:box', 'urn:p', 'urn:hand')
    """
    match = _EXCLUDED_LINK.fullmatch(atom[0])
    return (atom[1], match[1], atom[2]) if match is not None and len(atom) > 2 else None


# Facts about these alone change with whoever does the step; the goal and things do not care.
_OF_ITS_ROBOT = ("assignedTo", "engages")


@dataclass(frozen=True)
class Wording:
    """Names of what a plan mentions, and labels of properties."""

    names: Mapping[str, str]
    labels: Mapping[str, str]

    def name(self, iri: str) -> str:
        """Return the name of something."""
        return self.names.get(iri) or local_name(iri)

    def atom(self, atom: Atom) -> str:
        """Return a fact in words."""
        statement = statement_of(atom)
        if statement is not None:
            subject, prop, value = statement
            label = self.labels.get(prop) or local_name(prop)
            return f"{self.name(subject)} {label} {self.name(value)}"
        excluded = excluded_by(atom)
        if excluded is not None:
            label = self.labels.get(excluded[1]) or local_name(excluded[1])
            return f"{self.name(excluded[0])} is not {label}"
        link = excluded_link(atom)
        if link is not None:
            label = self.labels.get(link[1]) or local_name(link[1])
            return f"{self.name(link[0])} is not {label} {self.name(link[2])}"
        text = re.sub(r"<([^<>]*)>", lambda m: self.labels.get(m[1]) or local_name(m[1]), atom[0])
        names = {f"?{n}": self.name(value) for n, value in enumerate(atom[1:], 1)}
        text = re.sub(r"\?\d+", lambda m: names.get(m[0], m[0]), text)
        free = re.fullmatch(r"FILTER NOT EXISTS { \?a ([^?]*) }", text)
        return f"nothing is {free[1]}" if free else text

    def step(self, action: ActionClass, arguments: Mapping[str, str]) -> str:
        """Return a step in words."""
        return re.sub(
            r"\?(\w+)",
            lambda m: self.name(arguments[m[1]]) if m[1] in arguments else m[0],
            action.text,
        )


def planned_steps(
    actions: Sequence[ActionClass],
    problem: Problem,
    steps: Sequence[Step],
    experience: Experience,
    assumed: Sequence[Atom],
    wording: Wording,
    stages: Sequence[int] = (),
) -> tuple[PlannedStep, ...]:
    """Return the steps of a plan with reasons, expectations and the earliest start of each.

    A step begins when its robots are free and the steps have ended that make its preconditions
    true, or that needed what it undoes.

    Parameters
    ----------
    stages
        Numbers of the last steps of stages: what comes after one waits for all up to it.
    """
    classes = {action.iri: action for action in actions}
    result: list[PlannedStep] = []
    made: dict[Atom, int] = {}
    used: dict[Atom, list[int]] = {}
    ended: dict[Atom, list[int]] = {}
    ends: dict[int, float] = {0: 0.0}
    free: dict[str, float] = {}
    gate: list[int] = []
    for number, step in enumerate(steps, 1):
        action, arguments = classes[step.action], dict(step.arguments)
        statements = tuple((prop, arguments[name]) for prop, name in action.statements)
        robots = tuple(value for prop, value in statements if local_name(prop) == "assignedTo")
        causes = [(atom, made.get(atom, 0)) for atom in step.preconditions]
        causes += [(atom, n) for atom in step.deletes for n in used.get(atom, ())]
        causes += [(atom, n) for atom in step.adds for n in ended.get(atom, ())]
        before = [n for _, n in causes]
        own = {value for prop, value in statements if local_name(prop) in _OF_ITS_ROBOT}
        for_anyone = {n for atom, n in causes if not own.issuperset(atom[1:])}
        if number - 1 in stages:
            # Those for which no other waits: whatever else there is has ended before them. To wait
            # for a hand does not count, as the order has to hold whoever takes a step over.
            gate = sorted(ends.keys() - {0} - {n for done in result for n in done.after
                                               if n not in done.for_hand})  # fmt: skip
        before += gate
        after = tuple(sorted({n for n in before if n}))
        start_s = max(
            [ends[n] for n in before] + [free.get(robot, 0.0) for robot in robots] + [0.0]
        )
        counts = experience.counts(action, arguments)
        evidence = experience.evidence(action, arguments, wording.name)
        result.append(
            PlannedStep(
                number, step.action, arguments, statements, robots,
                wording.step(action, arguments), step.duration_s, step.chance,
                counts.successes, counts.attempts, start_s,
                tuple(_support(atom, made, assumed, wording) for atom in step.preconditions),
                after, evidence.text, evidence.query,
                tuple(n for n in after if n not in for_anyone and n not in gate),
            )
        )  # fmt: skip
        ends[number] = start_s + step.duration_s
        free.update(dict.fromkeys(robots, ends[number]))
        for atom in step.preconditions:
            used.setdefault(atom, []).append(number)
        for atom in step.deletes:
            ended.setdefault(atom, []).append(number)
        made.update(dict.fromkeys(step.adds, number))
    return tuple(result)


def with_ages(
    steps: Sequence[PlannedStep], seen: Mapping[str, dt.datetime], now: dt.datetime
) -> tuple[PlannedStep, ...]:
    """Return steps whose proofs say how long ago things were seen where a plan begins with them.

    Parameters
    ----------
    seen
        When each thing was seen last, by IRI.
    """

    def aged(item: Support) -> Support:
        is_place = item.statement is not None and item.statement[1] == RT.locatedOn.value
        if not is_place or item.step is not None or item.statement is None:
            return item
        when = seen.get(item.statement[0])
        age = "stated, not seen there" if when is None else f"seen there {_ago(now - when)} ago"
        return replace(item, text=f"{item.text} ({age})")

    return tuple(replace(step, supports=tuple(map(aged, step.supports))) for step in steps)


def _ago(age: dt.timedelta) -> str:
    """Return a time span in words, in its largest unit.

    >>> _ago(dt.timedelta(hours=50)), _ago(dt.timedelta(seconds=1))
    ('2 days', '1 second')
    """
    seconds = max(age.total_seconds(), 0)
    for unit, length_s in (("day", 86400), ("hour", 3600), ("minute", 60), ("second", 1)):
        number = int(seconds // length_s)
        if number or unit == "second":
            return f"{number} {unit}{'s' * (number != 1)}"
    raise AssertionError


def _support(
    atom: Atom, made: Mapping[Atom, int], assumed: Sequence[Atom], wording: Wording
) -> Support:
    return Support(wording.atom(atom), made.get(atom), statement_of(atom), atom in assumed)
