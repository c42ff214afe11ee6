"""``rtask entails``: does the graph entail a statement, or all that a file says?"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import open_to_read, reasoner_of
from rtask.cli.options import (
    data_option,
    exit_if_empty,
    json_option,
    print_json,
    server_option,
    term,
)
from rtask.cli.progress import Working, announce_compilation

if TYPE_CHECKING:
    from rtask.kb.commit.entailment import Entailment

_SHOWN = 10
_WORDS = {True: "yes", False: "no", None: "cannot be decided"}
_CONTRADICTORY = "yes: the graph contradicts itself, so everything follows; see `rtask reason`"


@click.command()
@click.argument("conclusion", nargs=-1, required=True, metavar="FILE | SUBJECT PREDICATE OBJECT")
@data_option
@server_option
@click.option(
    "--timeout",
    type=float,
    default=30.0,
    show_default=True,
    metavar="S",
    help="Time limit, s; a server has its own.",
)
@json_option
def entails(
    conclusion: tuple[str, ...], data: Path, server: str | None, timeout: float, as_json: bool
) -> None:
    """Tell whether a statement, or every statement of a file, follows from the graph.

    Write terms as in Turtle: <IRI>, prefix:name, "text", 0.3. FILE is an ontology or data in any
    format that can be loaded. Prints proofs of what follows, or what is missing. Exit code 0 if
    everything follows, 1 if something does not or cannot be decided.
    """
    from rtask.errors import UsageError

    if len(conclusion) not in (1, 3):
        raise UsageError("give one FILE, or SUBJECT PREDICATE OBJECT")
    if timeout <= 0:
        raise UsageError("--timeout is a number of seconds above 0")
    single = len(conclusion) == 3
    if server:
        triples = [_triple(conclusion, "")] if single else _read(conclusion[0])
        with Working("waiting for the server"), reasoner_of(server) as client:
            told = client.entails(triples)
            lines = list(_lines_told(told, client.explain(triples[0])["text"] if single else None))
    else:
        with announce_compilation(), Working("reasoning"), open_to_read(data) as kb:
            triples = [_triple(conclusion, kb.base)] if single else _read(conclusion[0])
            found = kb.entails(triples, budget_ms=1000 * timeout)
            told, lines = found.to_dict(), list(_lines(found, single))
    if as_json:
        print_json(told)
    else:
        for line in lines:
            click.echo(line)
    exit_if_empty(told["entailed"])


def _triple(parts: tuple[str, ...], base: str) -> tuple[Any, Any, Any]:
    subject, predicate, value = parts
    predicate = "rdf:type" if predicate == "a" else predicate
    return term(subject, base), term(predicate, base), term(value, base)


def _read(name: str) -> list[Any]:
    from rtask.rdf.documents import Document
    from rtask.rdf.formats import detect, statements

    document = Document.of(name)
    base = document.path.resolve().as_uri() if document.path else None
    quads = statements(document, detect(document), base)
    return [(quad.subject, quad.predicate, quad.object) for quad in quads]


def _lines_told(told: dict[str, Any], proof: str | None) -> Iterator[str]:
    """Yield the lines for what a server answered."""
    yield _CONTRADICTORY if told["contradictory"] else _WORDS[told["entailed"]]
    if proof is not None:
        yield proof
    for what in ("missing", "undecided"):
        for triple in told[what][:_SHOWN]:
            yield f"{what}: {' '.join(triple)}"
        if len(told[what]) > _SHOWN:
            yield f"and {len(told[what]) - _SHOWN} more {what} (--json lists all)"


def _lines(found: Entailment, single: bool) -> list[str]:
    if found.contradictory:
        return [_CONTRADICTORY]
    lines = [_WORDS[found.answer]]
    proofs = found.proofs if single else [p for p in found.proofs if not p.is_asserted]
    lines += [proof.render() for proof in proofs[:_SHOWN]]
    if len(proofs) > _SHOWN:
        lines.append(f"and {len(proofs) - _SHOWN} more proofs (--json lists all)")
    for what, triples in (("missing", found.missing), ("undecided", found.undecided)):
        lines += [f"{what}: {found.words(triple)}" for triple in triples[:_SHOWN]]
        if len(triples) > _SHOWN:
            lines.append(f"and {len(triples) - _SHOWN} more {what} (--json lists all)")
    return lines
