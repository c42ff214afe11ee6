"""``rtask query``, ``rtask update`` and ``rtask search``: ask and change the graph."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.changing.new_folder import open_or_make
from rtask.cli.connection import base_of, open_branch, open_graph, reasoner_of
from rtask.cli.options import (
    agent_option,
    announce_undo,
    branch_option,
    data_option,
    exit_if_empty,
    json_option,
    listing,
    prefixes,
    print_json,
    print_listing,
    read_text,
    server_option,
)
from rtask.cli.progress import Working
from rtask.cli.things import reader_at
from rtask.errors import QuerySyntaxError, UsageError

if TYPE_CHECKING:
    from rtask.graph import Graph
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
_MAX_WIDTH = 60
_HITS = 20
# An answer without rows is short, whatever its format.
_EMPTY_BYTES = 4096
_EMPTY = {
    "json": re.compile(rb'"bindings"\s*:\s*\[\s*\]|"boolean"\s*:\s*false'),
    "xml": re.compile(rb"<results\s*/>|<results>\s*</results>|<boolean>\s*false"),
    "csv": re.compile(rb"^[^\n]*\n?$"),
    "tsv": re.compile(rb"^[^\n]*\n?$"),
    "turtle": re.compile(rb"^\s*$"),
    "ntriples": re.compile(rb"^\s*$"),
    "rdfxml": re.compile(rb"^(?!.*rdf:Description).*$", re.S),
    "jsonld": re.compile(rb"^\s*\[\s*\]\s*$"),
}


@click.command()
@click.argument("text", required=False)
@data_option
@server_option
@branch_option
@click.option(
    "--file",
    type=click.Path(path_type=Path),
    help="Read the query from a file.",
)
@click.option(
    "--format",
    "-F",
    "form",
    type=click.Choice(["table", *_MEDIA_TYPES]),
    default="table",
    show_default=True,
    help="Format of the answer.",
)
@click.option("--json", "as_json", is_flag=True, help="The same as --format json.")
@click.option("--no-inferred", is_flag=True, help="Leave inferred statements out.")
@click.option("--timeout", type=float, metavar="S", help="Stop the query after this time, s.")
@click.option(
    "--check/--no-check",
    default=True,
    help="Say on standard error what is certainly wrong with the query, and what is likely wrong "
    "if it has no rows.  [default: check]",
)
def query(
    text: str | None,
    data: Path,
    server: str | None,
    branch: str | None,
    file: Path | None,
    form: str,
    as_json: bool,
    no_inferred: bool,
    timeout: float | None,
    check: bool,
) -> None:
    """Run a SPARQL query; TEXT may be - for standard input.

    The ontology's prefixes (rt:, cora:, prov: ...) are predefined, and so is kb: for the base of
    the knowledge base; SPARQL wants a backslash before a slash in a name, as in kb:object\\/7. Exit
    code 1 if there are no rows, or the answer to an ASK is no.
    """
    form = "json" if as_json else form
    asked = read_text(text, file)
    if server and no_inferred:
        raise UsageError("--no-inferred needs a folder; with a server, name the graphs with FROM")
    graph: AbstractContextManager[Graph] = (
        open_branch(data, server, branch) if branch else open_graph(data, server)
    )
    with graph as kb, _predefining(asked, base_of(kb)) as whole:
        if form == "table":
            answer = _print_answer(kb, whole, not no_inferred, timeout)
        else:
            answer = _write_answer(_pieces(kb, whole, form, not no_inferred, timeout), form)
        if check:
            _print_findings(kb, server, whole, len(whole) - len(asked), answer)
    exit_if_empty(answer)


def _print_findings(kb: Graph, server: str | None, whole: str, offset: int, has_rows: bool) -> None:
    """Print the faults of a query: certain ones always, likely ones beside an empty answer.

    Parameters
    ----------
    offset
        Characters before the text as it was given.
    """
    from rtask.asking.check.findings import place_of

    for finding in _findings(kb, server, whole):
        if has_rows and finding["severity"] != "certain":
            continue
        line, column = place_of(whole[offset:], finding["start"] - offset)
        click.echo(f"{finding['severity']}: {line}:{column}: {finding['detail']}", err=True)
        for repair in finding["repairs"][:1]:
            click.echo(f"  repair: {repair['words']}", err=True)


def _findings(kb: Graph, server: str | None, text: str) -> list[dict[str, Any]]:
    from rtask.errors import RtaskError
    from rtask.knowledge_base import KnowledgeBase

    if isinstance(kb, KnowledgeBase):
        return [finding.to_dict(text) for finding in kb.check(text)]
    if not server:
        return []
    try:
        with reasoner_of(server) as client:
            return client.check(text)
    except RtaskError:  # a server of another kind, which checks nothing
        return []


@contextmanager
def _predefining(asked: str, base: str) -> Iterator[str]:
    """Yield a text with the prefixes that it uses and does not declare.

    They stand in its first line, so an error there is raised again with the column of the text
    as it was given.
    """
    from rtask.rdf.terms import prologue

    lowered = " ".join(asked.lower().split())
    missing = {
        name: namespace
        for name, namespace in prefixes(base).items()
        if f"{name}:" in asked and f"prefix {name}:" not in lowered
    }
    before = prologue(missing).replace("\n", " ")
    try:
        yield before + asked
    except QuerySyntaxError as error:
        line, column = error.details.get("line"), error.details.get("column")
        if line != 1 or not isinstance(column, int) or column <= len(before):
            raise
        message = str(error).replace(f"1:{column}:", f"1:{column - len(before)}:", 1)
        raise QuerySyntaxError(message, line=1, column=column - len(before)) from error


def _pieces(
    kb: Graph, text: str, form: str, inferred: bool, timeout_s: float | None
) -> Iterator[bytes]:
    """Yield the answer in a format as it comes."""
    from rtask.knowledge_base import KnowledgeBase

    if not isinstance(kb, KnowledgeBase):
        yield kb.serialize(text, _MEDIA_TYPES[form])
        return
    with kb.stream(text, _MEDIA_TYPES[form], inferred=inferred, timeout_s=timeout_s) as answer:
        yield from answer


def _write_answer(pieces: Iterator[bytes], form: str) -> bool:
    """Write an answer; tell whether it holds anything."""
    head, last, size = b"", b"", 0
    for last in pieces:
        size += len(last)
        head += last[: max(_EMPTY_BYTES - len(head), 0)]
        click.echo(last, nl=False)
    if not last.endswith(b"\n"):
        click.echo()
    return size > _EMPTY_BYTES or _EMPTY[form].search(head) is None


def _print_answer(kb: Graph, text: str, inferred: bool, timeout_s: float | None) -> bool:
    """Print an answer for people; tell whether it holds anything."""
    from rtask.knowledge_base import KnowledgeBase
    from rtask.sparql.results import Solutions

    with Working("running the query"):
        if isinstance(kb, KnowledgeBase):
            answer = kb.query(text, inferred=inferred, timeout_s=timeout_s)
        else:
            answer = kb.query(text, timeout_s=timeout_s)
    if isinstance(answer, bool):
        click.echo("yes" if answer else "no")
        return answer
    if isinstance(answer, Solutions):
        _print_table(answer, base_of(kb))
        return len(answer) > 0
    written = answer.serialize()
    click.echo(written.decode(), nl=False)
    return bool(written.strip())


def _print_table(rows: Solutions, base: str) -> None:
    namespaces = prefixes(base)
    cells = [[_short(term, namespaces) for term in row] for row in rows]
    widths = [
        min(_MAX_WIDTH, max([len(name), *(len(line[at]) for line in cells)]))
        for at, name in enumerate(rows.variables)
    ]
    for line in ([*rows.variables], ["-" * width for width in widths], *cells):
        padded = "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True))
        click.echo(padded.rstrip())
    click.echo(f"{len(rows)} row{'' if len(rows) == 1 else 's'}", err=True)


def _short(term: object, namespaces: dict[str, str]) -> str:
    from rtask.rdf.terms import Literal, NamedNode, python_value

    if isinstance(term, Literal):
        return str(term.value)
    if not isinstance(term, NamedNode):
        return "" if term is None else str(python_value(term))  # type: ignore[arg-type]
    for name, namespace in namespaces.items():
        if term.value.startswith(namespace):
            return f"{name}:{term.value[len(namespace) :]}"
    return term.value


@click.command()
@click.argument("text", required=False)
@data_option
@server_option
@branch_option
@click.option("--file", type=click.Path(path_type=Path), help="Read the update from a file.")
@agent_option("Write as this robot or person, into its own graph. A server knows it by the token.")
@click.option("--note", help="Remark to keep with the provenance.")
@json_option
def update(
    text: str | None,
    data: Path,
    server: str | None,
    branch: str | None,
    file: Path | None,
    agent: str | None,
    note: str | None,
    as_json: bool,
) -> None:
    """Run a SPARQL update; TEXT may be - for standard input.

    The update is one commit: it is stored as a whole or not at all. The prefixes of `rtask query`
    are predefined here, too.
    """
    asked = read_text(text, file)
    graph: AbstractContextManager[Graph]
    if branch:
        graph = open_branch(data, server, branch)
    else:
        graph = open_graph(data, server) if server else open_or_make(data)
    with graph as kb, _predefining(asked, base_of(kb)) as whole:
        done = kb.update(whole, agent=agent, note=note)
    if done is None:
        click.echo('{"done": true}' if as_json else "done")
        if not as_json:
            click.echo(
                "a server does not name the commit: `rtask history` does where its folder is, and "
                "`rtask undo COMMIT` undoes it",
                err=True,
            )
        return
    if as_json:
        names = ("seq", "added", "removed", "derived", *(["remark"] if done.remark else []))
        print_json({name: getattr(done, name) for name in names})
        return
    click.echo(f"commit {done.seq}: +{done.added} -{done.removed}, {done.derived} derived")
    if done.remark:
        click.echo(done.remark, err=True)
    if branch:
        announce_undo("branch", "drop", branch)
    elif done.added or done.removed:
        announce_undo("undo", str(done.seq))


@click.command()
@click.argument("words", nargs=-1, required=True)
@data_option
@server_option
@click.option("--class", "-c", "cls", metavar="CLASS", help="Only instances of this class.")
@click.option("--lang", help="Only texts in this language, such as en.")
@listing(_HITS)
@json_option
def search(
    words: tuple[str, ...],
    data: Path,
    server: str | None,
    cls: str | None,
    lang: str | None,
    limit: int | None,
    as_json: bool,
) -> None:
    """Search names, labels, comments and descriptions for WORDS.

    All words must occur; "cup*" matches any ending. A server refuses words that more than 10,000
    texts have, rather than leave some out. Exit code 1 if nothing is found.
    """
    from rtask.knowledge_base import KnowledgeBase

    with open_graph(data, server) as kb:
        class_iri = None if cls is None else reader_at(kb).mentioned(cls)
        if not isinstance(kb, KnowledgeBase):
            rows = _search_server(kb, " ".join(words), class_iri, lang)
        else:
            hits = kb.search(" ".join(words), cls=class_iri, lang=lang, limit=sys.maxsize)
            rows = [
                {"iri": h.subject.value, "text": h.text, "language": h.language, "score": h.score}
                for h in hits
            ]

    def line(row: Mapping[str, Any]) -> str:
        tag = f"@{row['language']}" if row["language"] else ""
        text = " ".join(str(row["text"]).split())
        return f"{row['iri']}  {text[:100]}{tag}"

    print_listing(rows, limit, as_json, line, "nothing found", default=_HITS)


def _search_server(kb: Graph, words: str, cls: object, lang: str | None) -> list[dict[str, object]]:
    """Search through the text service of a SPARQL endpoint, which bounds the number of hits."""
    import ontology
    from rtask.rdf.terms import Literal, prologue, written

    asked = f"; rt:lang {written(Literal(lang))}" if lang else ""
    of_class = f"?iri a {cls} ." if cls is not None else ""
    rows = kb.select(
        prologue({"rt": ontology.NS})
        + f"""SELECT ?iri ?text (LANG(?text) AS ?language) ?score {{
  SERVICE <urn:rtask:text> {{ ?iri rt:matches {written(Literal(words))} {asked} ;
    rt:text ?text ; rt:score ?score }} {of_class}
}} ORDER BY DESC(?score)"""
    )
    return [{**row, "language": row["language"] or None} for row in rows.to_dicts()]
