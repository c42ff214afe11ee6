"""``rtask query``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.options import data_option, open_to_read, prefixes, read_text

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase
    from rtask.sparql.results import Solutions

_MEDIA_TYPES = {
    "json": "application/sparql-results+json",
    "xml": "application/sparql-results+xml",
    "csv": "text/csv",
    "tsv": "text/tab-separated-values",
    "turtle": "text/turtle",
    "ntriples": "application/n-triples",
    "rdfxml": "application/rdf+xml",
    "jsonld": "application/ld+json",
}
_WIDEST = 60


@click.command()
@click.argument("text", required=False)
@data_option
@click.option("--file", "-f", type=click.Path(path_type=Path), help="Read the query from a file.")
@click.option(
    "--format",
    "-o",
    "form",
    type=click.Choice(["table", *_MEDIA_TYPES]),
    default="table",
    show_default=True,
    help="How the answer is written.",
)
@click.option("--no-inferred", is_flag=True, help="Leave derived statements out.")
@click.option("--timeout", type=float, help="End the query after so many seconds.")
def query(
    text: str | None,
    data: Path,
    file: Path | None,
    form: str,
    no_inferred: bool,
    timeout: float | None,
) -> None:
    """Ask in SPARQL; TEXT may be - for standard input.

    The prefixes of the ontology (rt:, cora:, prov: ...) are known, and kb: for the base.
    """
    from rtask.rdf.terms import prologue

    asked = read_text(text, file)
    with open_to_read(data) as kb:
        missing = {
            name: namespace
            for name, namespace in prefixes(kb.base).items()
            if f"{name}:" in asked and f"prefix {name}:" not in " ".join(asked.lower().split())
        }
        whole = prologue(missing).replace("\n", " ") + asked
        if form != "table":
            _write(kb, whole, _MEDIA_TYPES[form], not no_inferred, timeout)
        else:
            _print(kb, whole, inferred=not no_inferred, timeout_s=timeout)


def _write(
    kb: KnowledgeBase, text: str, media_type: str, inferred: bool, timeout_s: float | None
) -> None:
    """Write the answer as it comes."""
    last = b""
    with kb.stream(text, media_type, inferred=inferred, timeout_s=timeout_s) as answer:
        for last in answer:
            click.echo(last, nl=False)
    if not last.endswith(b"\n"):
        click.echo()


def _print(kb: KnowledgeBase, text: str, inferred: bool, timeout_s: float | None) -> None:
    from rtask.sparql.results import Solutions

    answer = kb.query(text, inferred=inferred, timeout_s=timeout_s)
    if isinstance(answer, bool):
        click.echo("yes" if answer else "no")
    elif isinstance(answer, Solutions):
        _print_table(answer, kb.base)
    else:
        click.echo(answer.serialize().decode(), nl=False)


def _print_table(rows: Solutions, base: str) -> None:
    known = prefixes(base)
    cells = [[_short(term, known) for term in row] for row in rows]
    widths = [
        min(_WIDEST, max([len(name), *(len(line[at]) for line in cells)]))
        for at, name in enumerate(rows.variables)
    ]
    for line in ([*rows.variables], ["-" * width for width in widths], *cells):
        padded = "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))
        click.echo(padded.rstrip())
    click.echo(f"{len(rows)} rows", err=True)


def _short(term: object, known: dict[str, str]) -> str:
    from rtask.rdf.terms import Literal, NamedNode, python_value

    if isinstance(term, Literal):
        return str(term.value)
    if not isinstance(term, NamedNode):
        return "" if term is None else str(python_value(term))  # type: ignore[arg-type]
    for name, namespace in known.items():
        if term.value.startswith(namespace):
            return f"{name}:{term.value[len(namespace) :]}"
    return term.value
