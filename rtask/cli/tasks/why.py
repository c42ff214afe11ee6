"""``rtask why``: why something failed, and what would have mended it."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.connection import connection
from rtask.cli.options import data_option, json_option, print_json, server_option
from rtask.cli.things import name_or_iri

__all__ = ["why"]


@click.command()
@click.argument("subject", metavar="ATTEMPT|TASK|OBJECT")
@data_option
@server_option
@json_option
def why(subject: str, data: Path, server: str | None, as_json: bool) -> None:
    """Say why an attempt, a step or a plan failed, and what would have mended it.

    Of an object, by its name or IRI, its latest attempt that failed is meant.

    Causes come with their chances and what speaks for them; then comes the smallest changed fact
    (another grasp, hand, order, a look before) under which the graph expects it to have held. Exit
    code 1 if no change that is known would have sufficed.
    """
    subject = name_or_iri(subject, data, server)
    with connection(data, server) as client:
        answer = client.call("explain_failure", subject=subject)
    if as_json:
        print_json(dict(answer))
    else:
        click.echo(answer["text"])
    if not answer["held"] and not answer["mends"]:
        raise SystemExit(1)
