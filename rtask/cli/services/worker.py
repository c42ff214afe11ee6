"""``rtask worker``: carry out calls of services for a server."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import click

from rtask.cli.options import json_option

__all__ = ["worker"]


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="MODULE|FILE.py...")
@click.option(
    "--server",
    required=True,
    metavar="URL",
    envvar="RTASK_SERVER",
    show_envvar=True,
    help="Server that gives the calls. A token with the right deploy is read from RTASK_TOKEN.",
)
@click.option(
    "--slots",
    type=click.IntRange(1, 256),
    help="Calls of a service at a time.  [default: as the service says, or one for each core]",
)
@click.option(
    "--cache",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the files of data resources; workers of one machine may share it.  "
    "[default: a temporary one]",
)
@click.option("--text", is_flag=True, help="Send calls and answers as JSON, not as CBOR.")
@json_option
def worker(
    sources: tuple[str, ...],
    server: str,
    slots: int | None,
    cache: Path | None,
    text: bool,
    as_json: bool,
) -> None:
    """Carry out calls of services for a server, from any machine that reaches it.

    The worker connects outwards, so it needs no open port. It offers the services that the modules
    and files define, comes back when the connection was lost, and ends on Ctrl-C or SIGTERM after
    the calls in progress.
    """
    import json

    from rtask.client.worker import Worker
    from rtask.errors import UsageError
    from rtask.services.registry import load

    definitions = [definition for source in sources for definition in load(source)]
    for definition in definitions:
        if any(need.type == "graph" for need in definition.resources.values()):
            raise UsageError(f"{definition.exact} needs the graph, which is at the server only")

    def tell(state: str, words: str) -> None:
        if as_json:
            click.echo(json.dumps({"state": state, "detail": words}))
        else:
            click.echo(f"serving {words}" if state == "connected" else f"not connected: {words}")

    token = os.environ.get("RTASK_TOKEN")
    serving = Worker(server, definitions, token, slots, cache, is_binary=not text, on_state=tell)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: serving.stop())
    serving.run()
