"""``rtask entails``: does the graph entail a statement, or all that a file says?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import open_to_read
from rtask.cli.options import data_option, json_option, print_json, term
from rtask.cli.progress import Working, announce_compilation

if TYPE_CHECKING:
    from rtask.kb.commit.entailment import Entailment

_SHOWN = 10
_BUDGET_MS = 30_000


@click.command()
@click.argument("conclusion", nargs=-1, required=True, metavar="FILE | SUBJECT PREDICATE OBJECT")
@data_option
@click.option(
    "--timeout", type=float, default=30.0, show_default=True, metavar="S", help="Time limit, s."
)
@json_option
def entails(conclusion: tuple[str, ...], data: Path, timeout: float, as_json: bool) -> None:
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
    with announce_compilation(), Working("reasoning"), open_to_read(data) as kb:
        triples = _read(conclusion[0]) if len(conclusion) == 1 else [_triple(conclusion, kb.base)]
        found = kb.entails(triples, budget_ms=1000 * timeout)
        lines = list(_lines(found, len(conclusion) == 3))
    if as_json:
        print_json(found.to_dict())
    else:
        for line in lines:
            click.echo(line)
    if found.answer is not True:
        raise SystemExit(1)


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


def _lines(found: Entailment, single: bool) -> list[str]:
    if found.contradictory:
        return ["yes: the graph contradicts itself, so everything follows; see `rtask reason`"]
    words = {True: "yes", False: "no", None: "cannot be decided"}
    lines = [words[found.answer]]
    proofs = found.proofs if single else [p for p in found.proofs if not p.is_asserted]
    lines += [proof.render() for proof in proofs[:_SHOWN]]
    if len(proofs) > _SHOWN:
        lines.append(f"and {len(proofs) - _SHOWN} more proofs (--json lists all)")
    for what, triples in (("missing", found.missing), ("undecided", found.undecided)):
        lines += [f"{what}: {found.words(triple)}" for triple in triples[:_SHOWN]]
        if len(triples) > _SHOWN:
            lines.append(f"and {len(triples) - _SHOWN} more {what} (--json lists all)")
    return lines
