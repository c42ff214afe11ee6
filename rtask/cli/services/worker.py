"""``rtask worker``: carry out calls of services for a server."""

from __future__ import annotations

import os
import shlex
import signal
import sys
import threading
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
@click.option(
    "--up-to",
    default=1,
    show_default=True,
    type=click.IntRange(1, 256),
    help="Workers in all: another one starts while calls wait, and ends when fewer are enough.",
)
@click.option(
    "--start-with",
    metavar="COMMAND",
    help="Command that starts another worker, such as podman run.  [default: this one again]",
)
@click.option(
    "--idle",
    default=60.0,
    show_default=True,
    type=click.FloatRange(min=1),
    help="Seconds for which fewer must be enough before one ends.",
)
@click.option("--text", is_flag=True, help="Send calls and answers as JSON, not as CBOR.")
@json_option
def worker(
    sources: tuple[str, ...],
    server: str,
    slots: int | None,
    cache: Path | None,
    up_to: int,
    start_with: str | None,
    idle: float,
    text: bool,
    as_json: bool,
) -> None:
    """Carry out calls of services for a server, from any machine that reaches it.

    The worker connects outwards, so it needs no open port. It offers the services that the modules
    and files define, comes back when the connection was lost, and ends on Ctrl-C or SIGTERM after
    the calls in progress. With --up-to, it starts further workers by load, and ends them.
    """
    import json

    from rtask.client.work.scaling import Scaling
    from rtask.client.work.worker import Worker
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

    def tell_number(workers: int, words: str) -> None:
        if as_json:
            click.echo(json.dumps({"state": "scaled", "workers": workers, "detail": words}))
        else:
            click.echo(f"{workers} workers: {words}")

    token = os.environ.get("RTASK_TOKEN")
    serving = Worker(server, definitions, token, slots, cache, is_binary=not text, on_state=tell)
    if start_with is not None and up_to == 1:
        raise UsageError("--start-with says how further workers start; how many, --up-to")
    command = shlex.split(start_with) if start_with else _same_again()
    scaling = Scaling(server, token, serving.slots, command, up_to, idle, tell_number)

    def stop(*_: object) -> None:
        serving.stop()
        scaling.stop()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    others = threading.Thread(target=scaling.run, name="scaling")
    if up_to > 1:
        others.start()
    try:
        serving.run()
    finally:
        scaling.stop()
        if up_to > 1:
            others.join()


def _same_again() -> list[str]:
    """Return the command line of this worker, without the options of how many there are."""
    context = click.get_current_context()
    given = [sys.executable, "-m", "rtask", "worker"]
    for parameter in context.command.params:
        value = context.params[parameter.name or ""]
        if parameter.name in ("up_to", "start_with", "idle") or value in (None, False, ()):
            continue
        if isinstance(parameter, click.Argument):
            given += value
        else:
            given += [parameter.opts[0], *([] if value is True else [str(value)])]
    return given
