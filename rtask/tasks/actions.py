"""Actions as the graph describes them: classes of tasks with preconditions and effects."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rtask.errors import DataError
from rtask.rdf.namespaces import PREFIXES, local_name
from rtask.rdf.terms import NamedNode, python_value
from rtask.sparql.results import Solutions
from rtask.tasks.patterns import Pattern, parameters_of, parse_pattern

__all__ = ["ActionClass", "IsOntology", "Select", "read_actions"]

Select = Callable[[str], Solutions]
"""Evaluates a SELECT with the rights and within the bounds of whoever asks."""

IsOntology = Callable[[NamedNode], bool]
"""Whether a named graph holds an ontology."""

DEFAULT_DURATION_S = 10.0
_QUERY = f"""{PREFIXES}
SELECT ?action ?property ?value ?label ?graph WHERE {{
  GRAPH ?graph {{
    VALUES ?property {{ rt:actionParameters rt:precondition rt:addition rt:removal
      rt:planStatement rt:stepText rt:usualDuration }}
    ?action ?property ?value
  }}
  OPTIONAL {{ ?action rdfs:label ?label }}
}}"""


@dataclass(frozen=True)
class ActionClass:
    """A class of tasks that plans are made of.

    Parameters
    ----------
    iri
        Its IRI.
    label
        Its name for people.
    parameters
        Names and the IRIs of their classes.
    preconditions, additions, removals
        Patterns over the parameters.
    statements
        Properties of a planned task, each with the parameter that is its value.
    text
        A sentence with ``?name`` for parameters.
    duration_s
        How long it usually takes.
    is_duration_stated
        Whether somebody has said how long; else it is :data:`DEFAULT_DURATION_S`.
    """

    iri: str
    label: str
    parameters: tuple[tuple[str, str], ...]
    preconditions: tuple[Pattern, ...]
    additions: tuple[Pattern, ...]
    removals: tuple[Pattern, ...]
    statements: tuple[tuple[str, str], ...]
    text: str
    duration_s: float
    is_duration_stated: bool = True

    def parameter(self, name: str) -> str:
        """Return the parameter that is the value of a statement; "" if there is none."""
        return next((value for prop, value in self.statements if local_name(prop) == name), "")

    @property
    def changed(self) -> frozenset[str]:
        """Predicates that it changes."""
        return frozenset(pattern.predicate for pattern in (*self.additions, *self.removals))


def read_actions(select: Select, is_ontology: IsOntology) -> tuple[ActionClass, ...]:
    """Return the actions that ontologies describe, in the order of their IRIs.

    What robots store in their own graphs is data, and describes no action.

    Raises
    ------
    DataError
        The description of an action cannot be read; the message says which and why.
    """
    values: dict[str, dict[str, list[object]]] = defaultdict(lambda: defaultdict(list))
    labels: dict[str, str] = {}
    for row in select(_QUERY):
        graph = row["graph"]
        if not (isinstance(graph, NamedNode) and is_ontology(graph)):
            continue
        action, prop = str(row.value("action")), local_name(str(row.value("property")))
        value = python_value(row["value"])
        if value not in values[action][prop]:
            values[action][prop].append(value)
        labels[action] = str(row.value("label") or local_name(action))
    actions = tuple(
        _action(iri, labels[iri], values[iri])
        for iri in sorted(values)
        if values[iri]["actionParameters"]
    )
    _check(actions)
    return actions


def _action(iri: str, label: str, values: Mapping[str, Sequence[object]]) -> ActionClass:
    try:
        parameters = parameters_of(" . ".join(map(str, values["actionParameters"])))
        names = [name for name, _ in parameters]

        def patterns(key: str) -> tuple[Pattern, ...]:
            return tuple(parse_pattern(str(text), names) for text in sorted(map(str, values[key])))

        return ActionClass(
            iri, label, parameters,
            patterns("precondition"), patterns("addition"), patterns("removal"),
            tuple(sorted(_statement(str(text), names) for text in values["planStatement"])),
            " ".join(map(str, values["stepText"])) or _default_text(label, names),
            _duration(values["usualDuration"]), bool(values["usualDuration"]),
        )  # fmt: skip
    except DataError as error:
        raise DataError(f"action {local_name(iri)} <{iri}>: {error}", action=iri) from error


def _default_text(label: str, names: Sequence[str]) -> str:
    return f"{label}: {', '.join(f'?{name}' for name in names)}"


def _duration(values: Sequence[object]) -> float:
    numbers = [float(value) for value in values if isinstance(value, int | float)]
    return numbers[0] if numbers else DEFAULT_DURATION_S


def _statement(text: str, names: Sequence[str]) -> tuple[str, str]:
    pattern = parse_pattern(text, [*names, "task"])
    match = re.fullmatch(r"\?1 <([^<>]+)> \?2", pattern.predicate)
    if match is None or pattern.arguments[0] != "task":
        raise DataError(f"the statement {text!r} is not of the form ?task property ?parameter")
    return match[1], pattern.arguments[1]


def _check(actions: Sequence[ActionClass]) -> None:
    """Refuse preconditions that depend on what actions change, and that no action changes.

    Raises
    ------
    DataError
        Such a precondition would be taken as it is before the plan, whatever the plan does.
    """
    changed = {predicate for action in actions for predicate in action.changed}
    properties = {
        iri
        for action in actions
        for pattern in (*action.additions, *action.removals)
        if not pattern.is_negative
        for iri in pattern.properties
    }
    for action in actions:
        for pattern in action.preconditions:
            shared = pattern.properties & properties
            if pattern.predicate not in changed and shared:
                raise DataError(
                    f"action {local_name(action.iri)}: the precondition {pattern.predicate!r} has "
                    f"{local_name(min(shared))}, which actions change, but no action adds or "
                    "removes this pattern", action=action.iri,
                )  # fmt: skip
