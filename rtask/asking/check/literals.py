"""Literals whose datatype the property does not have, and things where a literal belongs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace

import ontology
from rtask.asking.check.evidence import Evidence
from rtask.asking.check.findings import Edit, Finding, Repair
from rtask.asking.check.repairs import turned_edits
from rtask.asking.check.syntax.outline import Edge, Node, Outline
from rtask.asking.check.types import family, range_of
from rtask.asking.check.vocabulary import Property, Vocabulary, local

__all__ = ["check_literals"]

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_TEXTS = {ontology.PREFIXES["rdfs"] + name for name in ("label", "comment")}
_DATE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d+)?(?:Z|[+-]\d\d:\d\d)")


def check_literals(
    outline: Outline,
    vocabulary: Vocabulary,
    evidence: Evidence,
    others: Callable[[Edge], list[Repair]],
) -> Iterator[Finding]:
    """Yield the constants of a query that the values of their property can never equal.

    Parameters
    ----------
    others
        Returns the properties that would fit instead.
    """
    for group in outline.body.walk():
        if group.role == "service":
            continue
        for edge in group.edges:
            if len(edge.steps) == 1 and not edge.is_loose:
                for finding in (*_constant(edge, vocabulary, evidence), *_label(edge, evidence)):
                    repairs = finding.repairs or tuple(others(edge))
                    yield replace(finding, repairs=repairs)


def _constant(edge: Edge, vocabulary: Vocabulary, evidence: Evidence) -> Iterator[Finding]:
    (step,) = edge.steps
    axioms = vocabulary.properties.get(step.node.value)
    about, value = edge.ends[:: -1 if step.is_inverse else 1]
    if about.kind == "literal":
        words = (
            f"the subject of {local(step.node.value)} is a literal here, of which nothing is said"
        )
        turned = Repair("turn the direction of the pattern", turned_edits(step))
        yield Finding("reversed", "certain", step.node.start, step.node.end, words, (turned,))
        return
    if axioms is None or value.kind == "variable":
        return
    name = local(axioms.iri)
    if value.kind == "iri":
        if axioms.relates_things is False:
            words = f"the values of {name} are literals, never a thing such as this"
            yield Finding("literal-expected", "certain", value.start, value.end, words)
        return
    if axioms.relates_things is True:
        words = f"the values of {name} are things, never a literal such as this"
        yield Finding("thing-expected", "certain", value.start, value.end, words)
        return
    # A graph may hold values of another type, such as xsd:dateTime for a time stamp.
    for finding in _datatype(value, axioms, name):
        if not evidence.matches(edge):
            yield finding


def _label(edge: Edge, evidence: Evidence) -> Iterator[Finding]:
    """Yield the fault of a label that is a number, or lacks the language of those in the graph."""
    (step,) = edge.steps
    value = edge.ends[0 if step.is_inverse else 1]
    if value.kind != "literal" or step.node.value not in _TEXTS:
        return
    name = local(step.node.value)
    if family(value.datatype) != "text":
        words = f"the values of {name} are texts, never a number or the like"
        text = value.value.replace("\\", "\\\\").replace('"', '\\"')
        repair = Repair(f'write "{text}"', (Edit(value.start, value.end, f'"{text}"'),))
        yield Finding("wrong-datatype", "likely", value.start, value.end, words, (repair,))
    elif not value.datatype.endswith("langString") and not evidence.matches(edge):
        languages = evidence.languages(step.node.value, value.value)
        repairs = [
            Repair(f"add @{language}", (Edit(value.end, value.end, f"@{language}"),))
            for language in languages
        ]
        if repairs:
            words = f"every {name} of this text has a language, so that the text alone equals none"
            yield Finding("no-language", "likely", value.start, value.end, words, tuple(repairs))


def _datatype(value: Node, axioms: Property, name: str) -> Iterator[Finding]:
    needed = range_of(axioms)
    if not needed or not family(needed) or value.datatype == needed:
        return
    kind = local(needed)
    if family(value.datatype) == family(needed) and family(needed) not in ("number", "text"):
        return
    if family(needed) == family(value.datatype) == "number" and (
        kind not in ("double", "float", "decimal") or local(value.datatype) == kind
    ):
        return
    if family(needed) == "text" and kind != "string" and not value.datatype.endswith("langString"):
        return
    words = f"the values of {name} are of type xsd:{kind}, and this is of another"
    yield Finding("wrong-datatype", "certain", value.start, value.end, words, _repairs(value, kind))


def _repairs(value: Node, kind: str) -> tuple[Repair, ...]:
    text = value.value
    if kind == "boolean" and text in ("true", "false", "0", "1"):
        written = {"0": "false", "1": "true"}.get(text, text)
    elif kind in ("double", "float") and _NUMBER.fullmatch(text):
        written = f'"{text}"^^<http://www.w3.org/2001/XMLSchema#{kind}>'
        if kind == "double":
            written = text if "e" in text.lower() else text.rstrip(".") + "e0"
    elif kind == "decimal" and _NUMBER.fullmatch(text) and "e" not in text.lower():
        written = text if "." in text else text + ".0"
    elif kind == "integer" and re.fullmatch(r"[+-]?\d+", text):
        written = text
    elif kind == "string":
        written = '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
    elif kind == "dateTime" and _DATE.fullmatch(text):
        written = f'"{text}"^^<http://www.w3.org/2001/XMLSchema#dateTime>'
    else:
        return ()
    return (Repair(f"write {written}", (Edit(value.start, value.end, written),)),)
