"""``rtask quarantine``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, open_to_read, print_json


@click.command()
@click.argument("records", nargs=-1)
@data_option
@click.option("--release", "action", flag_value="release", help="Put them back into their graphs.")
@click.option("--forget", "action", flag_value="forget", help="Give them up.")
@json_option
def quarantine(records: tuple[str, ...], data: Path, action: str | None, as_json: bool) -> None:
    """List statements that contradict the rest, put them back, or forget them.

    Statements come here where a knowledge base is opened with on_inconsistency="quarantine".
    RECORDS are IRIs from the list; without any, all of them are meant. Putting back fails, and
    changes nothing, while they still contradict the rest.
    """
    import rtask

    if action is not None:
        with rtask.open(data) as kb:
            before = len(kb.quarantined())
            kb.release(records or None, drop=action == "forget")
            verb = "put back" if action == "release" else "forgotten"
            click.echo(f"{before - len(kb.quarantined())} {verb}")
        return
    with open_to_read(data) as kb:
        found = [one for one in kb.quarantined() if not records or one.node.value in records]
    if as_json:
        print_json(
            [
                {
                    "record": one.node.value,
                    "triple": [
                        str(one.quad.subject),
                        str(one.quad.predicate),
                        str(one.quad.object),
                    ],
                    "graph": str(one.quad.graph_name),
                    "reason": one.reason,
                    "activity": one.activity.value,
                }
                for one in found
            ]
        )
        return
    for one in found:
        click.echo(f"{one.node.value}\n  {one.quad}\n  {one.reason}")
    click.echo(f"{len(found)} in quarantine")
