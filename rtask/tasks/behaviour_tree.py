"""Plans as behaviour trees in the XML of BehaviorTree.CPP 4, for others to run."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Protocol
from xml.etree import ElementTree

from rtask.rdf.namespaces import local_name

__all__ = ["TreeStep", "behaviour_tree"]

# A factory has these from the start, and refuses a second node of the name; the first ones are tags
# of the format.
_NODES = (
    "Root", "root", "BehaviorTree", "TreeNodesModel", "include",
    "Action", "Condition", "Control", "Decorator", "SubTree", "AlwaysFailure",
    "AlwaysSuccess", "AsyncFallback", "AsyncSequence", "Delay", "Fallback", "ForceFailure",
    "ForceSuccess", "IfThenElse", "Inverter", "KeepRunningUntilFailure", "LoopBool",
    "LoopDouble", "LoopInt", "LoopString", "ManualSelector", "Parallel", "ParallelAll",
    "Precondition", "ReactiveFallback", "ReactiveSequence", "Repeat", "RetryUntilSuccessful",
    "RunOnce", "Script", "ScriptCondition", "Sequence", "SequenceStar", "SequenceWithMemory",
    "SetBlackboard", "SkipUnlessUpdated", "Sleep", "Switch2", "Switch3", "Switch4", "Switch5",
    "Switch6", "Timeout", "TryCatch", "UnsetBlackboard", "WaitValueUpdate", "WasEntryUpdated",
    "WhileDoElse",
)  # fmt: skip
_PORTS = ("name", "ID")
# More than its reader refuses in names: an attribute of XML has fewer signs than a port.
_FORBIDDEN = re.compile(r"[^\w-]", re.ASCII)
# XML 1.0 has no way to write these (2.2), and a name in the graph may contain them.
_CONTROL = re.compile(r"[^\t\n\r\x20-\x7e\x80-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class TreeStep(Protocol):
    """A step of a plan, stored or not."""

    @property
    def action(self) -> str:
        """IRI of its class."""

    @property
    def arguments(self) -> Mapping[str, str]:
        """IRIs by parameter."""

    @property
    def text(self) -> str:
        """A sentence."""


def behaviour_tree(title: str, steps: Sequence[TreeStep]) -> str:
    """Return steps in this order as one sequence of actions, with the parameters as ports.

    An action has the local name of its class; a port has the name of a parameter, and its value is
    an IRI. Names that the reader of BehaviorTree.CPP refuses are changed as little as that takes.
    The model lists all ports for editors; a program registers each action with these ports, as the
    factory refuses those of which it has not heard.
    """
    identifiers = _identifiers([step.action for step in steps], local_name, _NODES)
    ports = {step.action: _identifiers(step.arguments, str, _PORTS) for step in steps}
    root = ElementTree.Element("root", BTCPP_format="4", main_tree_to_execute="Plan")
    tree = ElementTree.SubElement(root, "BehaviorTree", ID="Plan")
    sequence = ElementTree.SubElement(tree, "Sequence", name=_words(title))
    # Readers such as that of py_trees refuse two nodes of one name: a thing may be picked up twice.
    names = _distinct([_words(step.text) for step in steps])
    for name, step in zip(names, steps, strict=True):
        values = {ports[step.action][name]: value for name, value in step.arguments.items()}
        # The compact form of version 4; py_trees knows no other one.
        ElementTree.SubElement(sequence, identifiers[step.action], {"name": name, **values})
    models = ElementTree.SubElement(root, "TreeNodesModel")
    for step in _of_each_class(steps):
        action = ElementTree.SubElement(models, "Action", ID=identifiers[step.action])
        for name in step.arguments:
            port = ports[step.action][name]
            ElementTree.SubElement(action, "input_port", name=port, type="std::string")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _identifiers(
    names: Iterable[str], word_of: Callable[[str], str], reserved: Collection[str]
) -> Mapping[str, str]:
    """Return an identifier for each name: its word where that will do and nobody else has it."""
    identifiers: dict[str, str] = {}
    taken = set(reserved)
    for name in dict.fromkeys(names):
        word = _FORBIDDEN.sub("_", word_of(name))
        base = unique = word if word[:1].isalpha() else f"x{word}"
        number = 1
        while unique in taken:
            number += 1
            unique = f"{base}_{number}"
        taken.add(unique)
        identifiers[name] = unique
    return identifiers


def _words(text: str) -> str:
    return _CONTROL.sub(" ", text)


def _distinct(texts: Iterable[str]) -> list[str]:
    """Return texts, with a number where one comes again."""
    names: dict[str, None] = {}
    for text in texts:
        name, number = text, 1
        while name in names:
            number += 1
            name = f"{text} ({number})"
        names[name] = None
    return list(names)


def _of_each_class(steps: Sequence[TreeStep]) -> list[TreeStep]:
    classes: dict[str, TreeStep] = {}
    for step in steps:
        classes.setdefault(step.action, step)
    return list(classes.values())
