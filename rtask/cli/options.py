"""Options that several commands share, and how commands open a knowledge base."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["data_option", "json_option", "open_to_read", "print_json", "read_text", "term"]

data_option = click.option(
    "--data",
    "-d",
    type=click.Path(path_type=Path),
    default=Path("rtask-data"),
    show_default=True,
    envvar="RTASK_DATA",
    show_envvar=True,
    help="Folder of the knowledge base.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


def open_to_read(data: Path) -> KnowledgeBase:
    """Open a knowledge base for reading; one that was not closed is recovered first."""
    import rtask
    from rtask.errors import StoreError

    try:
        return rtask.open(data, mode="r")
    except StoreError as error:
        if not error.details.get("recover"):
            raise
    rtask.open(data, ontologies=False, reason=False).close()
    return rtask.open(data, mode="r")


def read_text(text: str | None, file: Path | None) -> str:
    """Return SPARQL text from the argument, a file, or standard input (``-``)."""
    from rtask.errors import UsageError

    if file is not None:
        try:
            return file.read_text("utf-8")
        except OSError as error:
            raise UsageError(f"{file}: {error.strerror}") from error
    if text is None:
        raise UsageError("give the text, --file FILE, or - for standard input")
    return sys.stdin.read() if text == "-" else text


def prefixes(base: str) -> dict[str, str]:
    """Return the prefixes that the command line knows: the ontology's, and ``kb:`` for the base."""
    import ontology

    return {**ontology.PREFIXES, "kb": base}


def term(text: str, base: str) -> Any:
    """Return the term of ``<iri>``, ``prefix:name``, an IRI, or a literal in Turtle.

    >>> term("rt:Mug", "urn:lab/").value.rpartition("#")[2], term('"3"', "urn:lab/").value
    ('Mug', '3')
    """
    from pyoxigraph import NamedNode, RdfFormat, parse

    from rtask.errors import UsageError
    from rtask.rdf.terms import prologue

    known = prefixes(base)
    if "://" in text or text.startswith("urn:"):
        return NamedNode(text)
    try:
        document = f"{prologue(known)}<urn:s> <urn:p> {text} ."
        return next(parse(document, format=RdfFormat.TURTLE)).object
    except (SyntaxError, ValueError) as error:
        raise UsageError(
            f"{text!r} is no term; write <IRI>, a prefixed name ({', '.join(known)}) or a literal"
        ) from error


def print_json(value: Any) -> None:
    """Print a value as one JSON document."""
    click.echo(json.dumps(value, indent=2, ensure_ascii=False, default=str))
