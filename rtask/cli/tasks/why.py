"""``rtask why``: why something failed, and what would have mended it."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.connection import connection
from rtask.cli.options import data_option, json_option, print_json, server_option
from rtask.cli.things import name_or_iri
from rtask.errors import UsageError
from rtask.extras import needs_extra

__all__ = ["why"]


@click.command()
@click.argument("subject", metavar="ATTEMPT|TASK|OBJECT")
@data_option
@server_option
@json_option
@click.option(
    "--try", "tries", is_flag=True,
    help="Try what would have mended it on branches, as `rtask simulate why` does; stores nothing.",
)  # fmt: skip
@click.option(
    "--keep-branch", "keep", metavar="NAME", default="",
    help="With --try: keep the best on a branch of this name.",
)  # fmt: skip
@click.pass_context
def why(
    context: click.Context, subject: str, data: Path, server: str | None, as_json: bool,
    tries: bool, keep: str,
) -> None:  # fmt: skip
    """Say why an attempt, a step or a plan failed, and what would have mended it.

    Of an object, by its name or IRI, its latest attempt that failed is meant.

    Causes come with their chances and what speaks for them; then comes the smallest changed fact
    (another grasp, hand, order, a look before) under which the graph expects it to have held. Of a
    step that has not ended, say why it is its robot's. Exit code 1 if something failed and no
    change that is known would have sufficed.
    """
    if keep and not tries:
        raise UsageError("--keep-branch: nothing is kept unless it is tried; add --try")
    if tries:
        context.invoke(
            _trial_command(context), subject=subject, data=data, server=server, as_json=as_json,
            keep=keep,
        )  # fmt: skip
        return
    subject = name_or_iri(subject, data, server)
    with connection(data, server) as client:
        answer = client.call("explain_failure", subject=subject)
    if as_json:
        print_json(dict(answer))
    else:
        click.echo(answer["text"])
    if answer["ended"] and not answer["held"] and not answer["mends"]:
        raise SystemExit(1)


def _trial_command(context: click.Context) -> click.Command:
    """Return the command of the simulation, which a core without it does not have.

    It is found by its name, since the core imports no simulation.
    """
    command: click.Command | None = context.find_root().command
    for name in ("simulate", "why"):
        command = command.get_command(context, name) if isinstance(command, click.Group) else None
    if command is None:
        raise needs_extra("simulate", "trying a change")
    return command
