"""``rtask stats``, ``rtask history`` and ``rtask export``: what a knowledge base holds."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import open_graph, open_to_read, read_address
from rtask.cli.options import (
    agent_option,
    data_option,
    exit_if_empty,
    json_option,
    listing_option,
    print_json,
    server_option,
    shown_rows,
)
from rtask.cli.progress import Working
from rtask.cli.things import name_or_iri
from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.kb.feed.history import HistoryEntry

_SIZES = "SELECT ?g (COUNT(*) AS ?n) { GRAPH ?g { ?s ?p ?o } } GROUP BY ?g ORDER BY ?g"
_TRIPLES = "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"


@click.command()
@data_option
@server_option
@listing_option
@json_option
def stats(data: Path, server: str | None, limit: int | None, as_json: bool) -> None:
    """Count triples, graphs and commits."""
    with Working("counting"):
        if server:
            statistics = _stats_of_server(data, server)
        else:
            with open_to_read(data) as kb:
                statistics = kb.stats()
    sizes = shown_rows(list(statistics["graphs"].items()), limit, as_json, what="graphs")
    statistics["graphs"] = dict(sizes)
    if as_json:
        print_json(statistics)
        return
    graphs = statistics.pop("graphs")
    for name, value in statistics.items():
        click.echo(f"{name:12s} {value}")
    for name, size in graphs.items():
        click.echo(f"{size:12d} {name}")


def _stats_of_server(data: Path, server: str) -> dict[str, Any]:
    """Return the counts that a server's SPARQL endpoint gives."""
    with open_graph(data, server) as kb:
        (total,) = kb.select(_TRIPLES).to_dicts()
        sizes = kb.select(_SIZES).to_dicts()
    return {
        "server": server,
        "triples": total["n"],
        "graphs": {str(row["g"]): row["n"] for row in sizes},
    }


@click.command()
@click.argument("subject", required=False)
@data_option
@click.option("--graph", "-g", help="Only this graph.")
@agent_option("Only what this robot or person wrote.")
@click.option("--since", default=0, help="Only commits after this number.")
@click.option("--upto", type=int, help="Only commits up to this number.")
@click.option("--from", "start", help="Only commits at this time (ISO 8601) or later.")
@click.option("--until", "end", help="Only commits before this time.")
@click.option("--statements", "-s", is_flag=True, help="List the statements of each commit.")
@listing_option
@json_option
def history(
    subject: str | None,
    data: Path,
    graph: str | None,
    agent: str | None,
    since: int,
    upto: int | None,
    start: str | None,
    end: str | None,
    statements: bool,
    limit: int | None,
    as_json: bool,
) -> None:
    """List commits: who wrote or withdrew what, and when; with --limit the latest.

    With SUBJECT, only commits about it. Exit code 1 if there are none.
    """
    from rtask.asking.terms import reader_of

    with open_to_read(data) as kb:
        reader = reader_of(kb)
        about = None if subject is None else reader.resource(subject)
        within = None if graph is None else reader.resource(graph)
        entries = kb.history(
            about, graph=within, agent=agent, since=since, upto=upto, start=start, end=end
        )
        kept_from = kb.feed.oldest_retained()
        if about is not None and not entries and kept_from <= 1:
            reader.mentioned(subject or "")  # no commit ever spoke of what nothing mentions
    if since + 1 < kept_from:
        gone = f"commits {since + 1} to {kept_from - 1} are no longer kept"
        click.echo(f"{gone}: what they changed is not known", err=True)
    entries = shown_rows(entries, limit, as_json, newest=True)
    if as_json:
        print_json([_entry_row(entry, statements) for entry in entries])
    else:
        for entry in entries:
            note = f"  {entry.note}" if entry.note else ""
            if entry.clock_back_s >= 1.0:
                note += f"  (clock {entry.clock_back_s:.0f} s behind an earlier commit)"
            click.echo(
                f"{entry.seq:6d}  {entry.time[:19]}  {entry.agent or '-':12s}  "
                f"+{len(entry.added)} -{len(entry.removed)}{note}"
            )
            if statements:
                for sign, quads in (("-", entry.removed), ("+", entry.added)):
                    for quad in quads:
                        click.echo(f"        {sign} {quad}")
    exit_if_empty(entries, "no commits")


def _entry_row(entry: HistoryEntry, statements: bool) -> dict[str, Any]:
    row: dict[str, Any] = {
        "seq": entry.seq,
        "time": entry.time,
        "agent": entry.agent,
        "note": entry.note,
        "clock_back_s": entry.clock_back_s,
        "added": len(entry.added),
        "removed": len(entry.removed),
    }
    if statements:
        row["statements_added"] = [str(quad) for quad in entry.added]
        row["statements_removed"] = [str(quad) for quad in entry.removed]
    return row


@click.command()
@click.argument("target", default="-")
@data_option
@server_option
@click.option("--graph", "-g", "graphs", multiple=True, help="Only this graph; may be repeated.")
@click.option(
    "--format",
    "-F",
    "form",
    help="Format: turtle, trig, nquads ...  [default: by the extension of TARGET, else trig]",
)
@click.option("--inferred", is_flag=True, help="Include inferred statements.")
@click.option(
    "--original", is_flag=True, help="Write the very bytes that one graph was loaded from."
)
@click.option("--json", "as_json", is_flag=True, help="Print the count as JSON; needs TARGET.")
def export(
    target: str,
    data: Path,
    server: str | None,
    graphs: tuple[str, ...],
    form: str | None,
    inferred: bool,
    original: bool,
    as_json: bool,
) -> None:
    """Write the graph to the file TARGET, or to standard output (-)."""
    if as_json and target == "-":
        raise UsageError("--json needs a TARGET file: the statements go to standard output")
    if original and (len(graphs) != 1 or target == "-"):
        raise UsageError("--original needs one --graph and a TARGET file")
    form = form or ("trig" if target == "-" else None)
    graphs = tuple(name_or_iri(graph, data, server) for graph in graphs)
    with Working("exporting"):
        if server:
            if original or inferred:
                raise UsageError("--original and --inferred need the folder, not a server")
            count, unit = _export_from_server(server, target, form, graphs), "bytes"
        elif original:
            from rtask.loader.export import original as write_original

            with open_to_read(data) as kb:
                count, unit = write_original(kb, graphs[0], target), "bytes"
        else:
            with open_to_read(data) as kb:
                out = sys.stdout.buffer if target == "-" else Path(target)
                count, unit = kb.dump(out, form, graphs or None, inferred), "statements"
    if as_json:
        print_json({"target": target, unit: count})
    else:
        click.echo(f"{count} {unit}", err=True)


def _export_from_server(server: str, target: str, form: str | None, graphs: tuple[str, ...]) -> int:
    """Write graphs by the Graph Store HTTP Protocol; return the number of bytes."""
    from rtask.rdf.formats import find_format

    if len(graphs) > 1:
        raise UsageError("a server exports one graph, or all: give --graph at most once")
    rdf = find_format(form or Path(target).suffix.lstrip(".") or "trig").rdf
    if rdf is None:
        raise UsageError(f"{form or target}: this format can only be read; use turtle or trig")
    asked = {"graph": graphs[0]} if graphs else {}
    content = read_address(server, "/store", asked, {"Accept": rdf.media_type}, timeout_s=600.0)
    if target == "-":
        sys.stdout.buffer.write(content)
    else:
        Path(target).write_bytes(content)
    return len(content)
