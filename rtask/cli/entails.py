"""``rtask entails``: does the graph entail a statement, or all that a file says?"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import open_to_read, reasoner_of
from rtask.cli.options import (
    budget_option,
    data_option,
    exit_if_empty,
    exit_undecided,
    json_option,
    listing,
    print_json,
    server_option,
    shown_parts,
    shown_rows,
)
from rtask.cli.progress import Working, announce_compilation

if TYPE_CHECKING:
    from rtask.client.reasoner import ReasonerClient
    from rtask.kb.commit.entailment import Entailment
    from rtask.knowledge_base import KnowledgeBase

_SHOWN = 10
_STEPS_A_SECOND, _MAX_S = 50_000, 1e6
_WORDS = {True: "yes", False: "no", None: "cannot be decided"}
_CONTRADICTORY = "yes: the graph contradicts itself, so everything follows; see `rtask reason`"


@dataclass(frozen=True)
class _Part:
    """Part of an answer as people read it.

    Parameters
    ----------
    name
        What its rows are, where they may be many; they are then bounded by ``--limit``.
    written
        Returns a row as text.
    """

    name: str
    rows: Sequence[Any]
    written: Callable[[Any], str] = str


@click.command()
@click.argument("conclusion", nargs=-1, required=True, metavar="FILE | SUBJECT PREDICATE OBJECT")
@data_option
@server_option
@budget_option
@click.option("--timeout", type=float, hidden=True)  # the bound of earlier releases
@listing(_SHOWN)
@json_option
def entails(
    conclusion: tuple[str, ...],
    data: Path,
    server: str | None,
    budget: int | None,
    timeout: float | None,
    limit: int | None,
    as_json: bool,
) -> None:
    """Tell whether a statement, or every statement of a file, follows from the graph.

    Write terms as any command prints them: <IRI>, prefix:name, kb:name, "a name", "text", 0.3.
    FILE is an ontology or data in any format that can be loaded. Prints proofs of what follows, or
    what is missing. Exit code 0 if everything follows, 1 if something does not, 3 if something
    could not be decided.
    """
    from rtask.errors import UsageError

    if len(conclusion) not in (1, 3):
        raise UsageError("give one FILE, or SUBJECT PREDICATE OBJECT")
    if timeout is not None:
        if not timeout > 0:
            raise UsageError("--timeout is a number of seconds above 0")
        budget = budget or max(1, int(min(timeout, _MAX_S) * _STEPS_A_SECOND))
    if server:
        with Working("waiting for the server"), reasoner_of(server) as client:
            entailment, parts = _ask_server(client, conclusion, budget)
    else:
        with announce_compilation(), Working("reasoning"), open_to_read(data) as kb:
            entailment, parts = _ask_folder(kb, conclusion, budget)
    if as_json:
        print_json(shown_parts(entailment, limit, as_json))
    for part in () if as_json else parts:
        rows = part.rows
        if part.name:
            rows = shown_rows(rows, limit, as_json, default=_SHOWN, what=part.name)
        for row in rows:
            click.echo(part.written(row))
    exit_undecided(entailment["entailed"])
    exit_if_empty(entailment["entailed"])


def _ask_server(
    client: ReasonerClient, conclusion: tuple[str, ...], budget: int | None
) -> tuple[dict[str, Any], list[_Part]]:
    if len(conclusion) == 1:
        entailment = client.entails(_read(conclusion[0]), budget)
        return entailment, list(_parts_of_answer(entailment, None))
    subject, predicate, value = conclusion
    entailment = client.entails_statement((subject, predicate, value), budget)
    explained = client.explain((subject, predicate, value), budget)
    proof = explained["text"] or explained["reason"]
    return entailment, list(_parts_of_answer(entailment, proof))


def _ask_folder(
    kb: KnowledgeBase, conclusion: tuple[str, ...], steps: int | None
) -> tuple[dict[str, Any], list[_Part]]:
    from rtask.asking.terms import reader_of
    from rtask.kb.reasoning import ENTAILMENT_BUDGET

    budget = steps or ENTAILMENT_BUDGET
    if len(conclusion) == 1:
        entailment = kb.entails(_read(conclusion[0]), budget=budget)
        return entailment.to_dict(), list(_parts(entailment, None))
    triple = reader_of(kb).statement(*conclusion)
    entailment = kb.entails([triple], budget=budget)
    lacks = kb.explain(*triple, budget=budget).render() if entailment.answer is False else ""
    return entailment.to_dict(), list(_parts(entailment, lacks))


def _read(name: str) -> list[Any]:
    from rtask.rdf.documents import Document
    from rtask.rdf.formats import detect, statements

    document = Document.of(name)
    base = document.path.resolve().as_uri() if document.path else None
    quads = statements(document, detect(document), base)
    return [(quad.subject, quad.predicate, quad.object) for quad in quads]


def _parts_of_answer(entailment: dict[str, Any], proof: str | None) -> Iterator[_Part]:
    """Yield the parts of what a server answered."""
    verdict = _CONTRADICTORY if entailment["contradictory"] else _WORDS[entailment["entailed"]]
    yield _Part("", [verdict, *([] if proof is None else [proof])])
    for what in ("missing", "undecided"):
        yield _Part(what, [f"{what}: {' '.join(triple)}" for triple in entailment[what]])
    if entailment["is_spent"]:
        yield _Part("", [_spent(entailment["budget"])])


def _spent(budget: int) -> str:
    return f"the budget of {budget} steps did not suffice; ask for more with --budget {10 * budget}"


def _parts(entailment: Entailment, single: str | None) -> Iterator[_Part]:
    """Yield the parts of an answer; for a single statement, with what it lacks."""
    if entailment.contradictory:
        yield _Part("", [_CONTRADICTORY])
        return
    yield _Part("", [_WORDS[entailment.answer]])
    proofs = (
        entailment.proofs
        if single is not None
        else [p for p in entailment.proofs if not p.is_asserted]
    )
    yield _Part("proofs", proofs, lambda proof: str(proof.render()))
    for what, triples in (("missing", entailment.missing), ("undecided", entailment.undecided)):
        yield _Part(what, [f"{what}: {entailment.words(triple)}" for triple in triples])
    yield _Part("", (single or "").splitlines()[1:])
    if entailment.is_spent:
        yield _Part("", [_spent(entailment.budget)])
