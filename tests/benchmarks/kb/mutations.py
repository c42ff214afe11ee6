"""Seeded changes of the meaning of queries, over every triple pattern of each."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

from rtask.asking.check.syntax.outline import Edge, Node, Outline
from rtask.asking.check.syntax.reading import read_outline
from rtask.asking.check.syntax.writing import written
from rtask.asking.check.types import TYPE
from rtask.asking.check.vocabulary import Vocabulary, local

__all__ = ["KINDS", "Mutation", "mutations"]

KINDS = (
    "unknown property", "unknown class", "wrong property", "wrong class", "reversed",
    "misspelt variable", "wrong literal",
)  # fmt: skip


@dataclass(frozen=True)
class Mutation:
    """A changed query.

    Parameters
    ----------
    kind
        One of ``KINDS``.
    text
        The changed query.
    """

    kind: str
    text: str


def mutations(text: str, vocabulary: Vocabulary, seed: int) -> Iterator[Mutation]:
    """Yield the changes of a query: each kind that fits, for each of its triple patterns."""
    draw = random.Random(f"{seed} {text}")
    outline = read_outline(text)
    for group in outline.body.walk():
        if group.role == "service":
            continue
        for edge in group.edges:
            if len(edge.steps) == 1:
                yield from _of_edge(text, outline, edge, vocabulary, draw)


def _of_edge(
    text: str, outline: Outline, edge: Edge, vocabulary: Vocabulary, draw: random.Random
) -> Iterator[Mutation]:
    (step,) = edge.steps
    node = step.node
    if node.value == TYPE:
        node = edge.object
        if node.kind != "iri":
            return
        yield Mutation("unknown class", _put(text, node, _misspelt(text, node, draw)))
        names = sorted(one for one in vocabulary.bit if one.startswith(_NS) and one != node.value)
        other = written(draw.choice(names), outline.prefixes)
        yield Mutation("wrong class", _put(text, node, other))
    else:
        yield Mutation("unknown property", _put(text, node, _misspelt(text, node, draw)))
        names = sorted(p for p in vocabulary.properties if p.startswith(_NS) and p != node.value)
        other = written(draw.choice(names), outline.prefixes)
        yield Mutation("wrong property", _put(text, node, other))
        if not step.is_inverse:
            turned = text[: node.start] + "^" + text[node.start :]
            yield Mutation("reversed", turned)
    for end in edge.ends:
        if end.kind == "variable" and end.end - end.start > 4:
            yield Mutation("misspelt variable", _put(text, end, _misspelt(text, end, draw)))
        elif end.kind == "literal":
            yield Mutation("wrong literal", _put(text, end, _retyped(text[end.start : end.end])))


_NS = "https://w3id.org/rtask-kg/ns#"


def _put(text: str, node: Node, other: str) -> str:
    return text[: node.start] + other + text[node.end :]


def _misspelt(text: str, node: Node, draw: random.Random) -> str:
    """Return a name with a letter dropped, doubled, or changed with its neighbour."""
    whole = text[node.start : node.end]
    name = local(whole.rstrip(">")) if node.kind == "iri" else whole[1:]
    at = draw.randrange(1, max(len(name) - 1, 2))
    changed = draw.choice(
        (
            name[:at] + name[at + 1 :],
            name[:at] + name[at : at + 1] * 2 + name[at + 1 :],
            name[:at] + name[at + 1 : at + 2] + name[at : at + 1] + name[at + 2 :],
        )
    )
    if changed == name:
        changed = name + "x"
    return whole.replace(name, changed) if node.kind != "variable" else whole[0] + changed


def _retyped(literal: str) -> str:
    """Return a literal of another type: a number or a word in quotes, or a number for a text."""
    return "7" if literal[0] in "\"'" else f'"{literal}"'
