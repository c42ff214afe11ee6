"""``rtask entails``: does the graph entail a statement, or all that a file says?"""

from __future__ import annotations

from collections.abc import Iterator
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
    print_json,
    server_option,
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


@click.command()
@click.argument("conclusion", nargs=-1, required=True, metavar="FILE | SUBJECT PREDICATE OBJECT")
@data_option
@server_option
@budget_option
@click.option("--timeout", type=float, hidden=True)  # the bound of earlier releases
@json_option
def entails(
    conclusion: tuple[str, ...],
    data: Path,
    server: str | None,
    budget: int | None,
    timeout: float | None,
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
            entailment, lines = _ask_server(client, conclusion, budget)
    else:
        with announce_compilation(), Working("reasoning"), open_to_read(data) as kb:
            entailment, lines = _ask_folder(kb, conclusion, budget)
    if as_json:
        print_json(entailment)
    else:
        for line in lines:
            click.echo(line)
    exit_undecided(entailment["entailed"])
    exit_if_empty(entailment["entailed"])


def _ask_server(
    client: ReasonerClient, conclusion: tuple[str, ...], budget: int | None
) -> tuple[dict[str, Any], list[str]]:
    if len(conclusion) == 1:
        entailment = client.entails(_read(conclusion[0]), budget)
        return entailment, list(_verdict_lines(entailment, None))
    subject, predicate, value = conclusion
    entailment = client.entails_statement((subject, predicate, value), budget)
    explained = client.explain((subject, predicate, value), budget)
    return entailment, list(_verdict_lines(entailment, explained["text"] or explained["reason"]))


def _ask_folder(
    kb: KnowledgeBase, conclusion: tuple[str, ...], steps: int | None
) -> tuple[dict[str, Any], list[str]]:
    from rtask.asking.terms import reader_of
    from rtask.kb.reasoning import ENTAILMENT_BUDGET

    budget = steps or ENTAILMENT_BUDGET
    if len(conclusion) == 1:
        entailment = kb.entails(_read(conclusion[0]), budget=budget)
        return entailment.to_dict(), _lines(entailment, None)
    triple = reader_of(kb).statement(*conclusion)
    entailment = kb.entails([triple], budget=budget)
    lacks = kb.explain(*triple, budget=budget).render() if entailment.answer is False else ""
    return entailment.to_dict(), _lines(entailment, lacks)


def _read(name: str) -> list[Any]:
    from rtask.rdf.documents import Document
    from rtask.rdf.formats import detect, statements

    document = Document.of(name)
    base = document.path.resolve().as_uri() if document.path else None
    quads = statements(document, detect(document), base)
    return [(quad.subject, quad.predicate, quad.object) for quad in quads]


def _verdict_lines(entailment: dict[str, Any], proof: str | None) -> Iterator[str]:
    """Yield the lines for what a server answered."""
    yield _CONTRADICTORY if entailment["contradictory"] else _WORDS[entailment["entailed"]]
    if proof is not None:
        yield proof
    for what in ("missing", "undecided"):
        for triple in entailment[what][:_SHOWN]:
            yield f"{what}: {' '.join(triple)}"
        if len(entailment[what]) > _SHOWN:
            yield f"and {len(entailment[what]) - _SHOWN} more {what} (--json lists all)"
    if entailment["is_spent"]:
        yield _more(entailment["budget"])


def _more(budget: int) -> str:
    return f"the budget of {budget} steps did not suffice; ask for more with --budget {10 * budget}"


def _lines(entailment: Entailment, single: str | None) -> list[str]:
    """Return the lines for an answer; for a single statement, with what it lacks."""
    if entailment.contradictory:
        return [_CONTRADICTORY]
    lines = [_WORDS[entailment.answer]]
    proofs = (
        entailment.proofs
        if single is not None
        else [p for p in entailment.proofs if not p.is_asserted]
    )
    lines += [proof.render() for proof in proofs[:_SHOWN]]
    if len(proofs) > _SHOWN:
        lines.append(f"and {len(proofs) - _SHOWN} more proofs (--json lists all)")
    for what, triples in (("missing", entailment.missing), ("undecided", entailment.undecided)):
        lines += [f"{what}: {entailment.words(triple)}" for triple in triples[:_SHOWN]]
        if len(triples) > _SHOWN:
            lines.append(f"and {len(triples) - _SHOWN} more {what} (--json lists all)")
    lines += (single or "").splitlines()[1:]
    if entailment.is_spent:
        lines.append(_more(entailment.budget))
    return lines
