"""``rtask history``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, open_to_read, term


@click.command()
@click.argument("subject", required=False)
@data_option
@click.option("--graph", "-g", help="Only this graph.")
@click.option("--agent", help="Only what this robot or person wrote.")
@click.option("--since", default=0, help="Only commits after this number.")
@click.option("--upto", type=int, help="Only commits up to this number.")
@click.option("--from", "start", help="Only commits at this time (ISO 8601) or later.")
@click.option("--until", "end", help="Only commits before this time.")
@click.option("--statements", "-s", is_flag=True, help="Show the statements too.")
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
) -> None:
    """Say who wrote or withdrew what, and when."""
    with open_to_read(data) as kb:
        about = None if subject is None else term(subject, kb.base)
        entries = kb.history(
            about, graph=graph, agent=agent, since=since, upto=upto, start=start, end=end
        )
        for entry in entries:
            note = f"  {entry.note}" if entry.note else ""
            click.echo(
                f"{entry.seq:6d}  {entry.time[:19]}  {entry.agent or '-':12s}  "
                f"+{len(entry.added)} -{len(entry.removed)}{note}"
            )
            if statements:
                for sign, quads in (("-", entry.removed), ("+", entry.added)):
                    for quad in quads:
                        click.echo(f"        {sign} {quad}")
