"""What a robot does for a step of each class of tasks.

A package adds one by an entry point of the group ``rtask.actions``: its name is the IRI of the
class, its value a class with the methods of :class:`TaskAction`. What the graph says names no code.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import Protocol
from urllib.parse import unquote

import ontology
from rtask.rdf.namespaces import local_name
from simulate.tasks.body import Deed, TaskBody

__all__ = ["NOT_SEEN", "Grasp", "HandOver", "Place", "TaskAction", "available_actions"]

NOT_SEEN = "it is not seen at"
"""How the comment of a step begins whose thing is not where the plan has it."""

Arguments = Mapping[str, str]


class TaskAction(Protocol):
    """A class of steps as a robot carries them out."""

    is_grasp: bool
    """Whether its outcome is one of a grasp, which others learn from."""

    def target(self, arguments: Arguments) -> str:
        """Return the place or hand where the thing is after it; empty if it stays."""

    def missing(self, body: TaskBody, arguments: Arguments) -> str:
        """Look before acting; return what is not as the step needs it, empty if all is."""

    def carry_out(self, body: TaskBody, arguments: Arguments) -> Deed:
        """Do it."""


class Grasp:
    """Pick a thing up from a place."""

    is_grasp = True

    def target(self, arguments: Arguments) -> str:
        """Return the hand."""
        return arguments["hand"]

    def missing(self, body: TaskBody, arguments: Arguments) -> str:
        """Look whether the thing is where the plan has it."""
        seen = body.sees(arguments["thing"], arguments["place"])
        return "" if seen else f"{NOT_SEEN} {unquote(local_name(arguments['place']))}"

    def carry_out(self, body: TaskBody, arguments: Arguments) -> Deed:
        """Pick it up."""
        return body.pick(arguments["thing"], arguments["place"], arguments["hand"])


class Place:
    """Put a held thing at a place."""

    is_grasp = False

    def target(self, arguments: Arguments) -> str:
        """Return the place."""
        return arguments["place"]

    def missing(self, body: TaskBody, arguments: Arguments) -> str:
        """Look whether the thing is in the hand."""
        return (
            "" if body.sees(arguments["thing"], arguments["hand"]) else "the hand does not hold it"
        )

    def carry_out(self, body: TaskBody, arguments: Arguments) -> Deed:
        """Put it down."""
        return body.put(arguments["thing"], arguments["place"], arguments["hand"])


class HandOver(Place):
    """Give a held thing into the hand of another robot."""

    def target(self, arguments: Arguments) -> str:
        """Return the other hand."""
        return arguments["target"]

    def carry_out(self, body: TaskBody, arguments: Arguments) -> Deed:
        """Give it."""
        return body.give(arguments["thing"], arguments["hand"], arguments["target"])


@cache
def available_actions() -> Mapping[str, TaskAction]:
    """Return the actions that robots can carry out, by the IRIs of their classes."""
    available: dict[str, TaskAction] = {
        ontology.NS + "Grasp": Grasp(),
        ontology.NS + "Place": Place(),
        ontology.NS + "HandOver": HandOver(),
    }
    for entry in entry_points(group="rtask.actions"):
        available[entry.name] = entry.load()()
    return available
