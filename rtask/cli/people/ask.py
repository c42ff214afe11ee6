"""``rtask ask``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import connection, server_option
from rtask.cli.options import data_option, json_option, print_json

if TYPE_CHECKING:
    from rtask.engine.operations.answers import ResolvedRequest

__all__ = ["ask"]


@click.command()
@click.argument("words", nargs=-1, required=True)
@data_option
@server_option
@click.option("--robot", help="Whose hand is to hold it; over a folder.")
@click.option("--gripper", help="Name or IRI of the hand, where the robot has several.")
@click.option(
    "--object", "-o", "objects", multiple=True, metavar="IRI", help="An object that is seen now."
)
@click.option(
    "--seen-within",
    default=600.0,
    show_default=True,
    metavar="S",
    help="Without --object: how fresh a look counts, s.",
)
@json_option
def ask(
    words: tuple[str, ...],
    data: Path,
    server: str | None,
    robot: str | None,
    gripper: str | None,
    objects: tuple[str, ...],
    seen_within: float,
    as_json: bool,
) -> None:
    """Ask for a kind or a use of thing: "something to drink from".

    Says which of the objects that are seen serves, why, and how it is taken; or why none does, with
    exit code 1.
    """
    request: dict[str, Any] = {"wanted": " ".join(words), "seen_within_s": seen_within}
    if gripper:
        request["gripper_id"] = gripper
    if objects:
        request["objects"] = list(objects)
    with connection(data, server, robot) as client:
        answer = client.resolve_request(**request)
    if as_json:
        print_json(answer)
    else:
        _show(answer)
    if answer["task_response"] == "unmet":
        raise SystemExit(1)


def _show(answer: ResolvedRequest) -> None:
    if answer["object"]:
        click.echo(f"{answer['label']}  {answer['object']}")
        click.echo(answer["explanation"]["text"])
        for grasp in answer["grasps"]:
            stats, sure = grasp["statistics"], grasp["confidence"]["mean"]
            click.echo(
                f"  {grasp['id']}  confidence {sure:.2f}, "
                f"held {stats['successes']} of {stats['attempts']}"
            )
        for line in answer["explanation"]["proof"]:
            click.echo(f"  {line}")
    for reason in answer["reasons"]:
        click.echo(f"{reason['code']}: {reason['text']}", err=not answer["object"])
