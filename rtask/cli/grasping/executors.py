"""``--executor``: where the work of a plan runs, the same option for every command."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import click

from rtask.errors import UsageError

if TYPE_CHECKING:
    from grasp.push.shards import Executor

__all__ = ["executor_options", "open_named"]

F = TypeVar("F", bound=Callable[..., Any])


def executor_options(what: str, prefix: str = "") -> Callable[[F], F]:
    """Add the options of :func:`open_named` to a command.

    Parameters
    ----------
    what
        What runs, for the help.
    prefix
        Of each line of help.
    """
    where = f"{prefix}{'where' if prefix else 'Where'} {what} run."
    options = [
        click.option(
            "--executor",
            type=click.Choice(["serial", "threads", "processes", "server", "ray"]),
            default="serial",
            show_default=True,
            help=f"{where} server: on that of --server and the workers connected to it; ray: on "
            "the running cluster of --cluster.",
        ),
        click.option(
            "--server",
            metavar="URL",
            envvar="RTASK_SERVER",
            show_envvar=True,
            help=f"{prefix}URL of --executor server. Its token is read from RTASK_TOKEN.",
        ),
        click.option(
            "--cluster",
            metavar="ADDRESS",
            help=f"{prefix}Ray cluster that is running, or auto for the one of this machine.",
        ),
        click.option(
            "--workers",
            default=0,
            help=f"{prefix}number of workers; 0 = one for each core, of a server eight calls at a "
            "time."
            if prefix
            else "Number of workers; 0 = one for each core, of a server eight calls at a time.",
        ),
    ]

    def add(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def open_named(options: Mapping[str, Any]) -> Executor:
    """Return what the options name; a context manager.

    Raises
    ------
    UsageError
        ``--executor server`` without a server.
    ValueError
        No such cluster, or fewer than 0 workers.
    """
    from grasp.push import open_executor

    if options["executor"] != "server":
        return open_executor(options["executor"], options["workers"], options["cluster"])
    from rtask.client.trials import ServerExecutor

    if not options["server"]:
        raise UsageError("--executor server needs --server URL")
    if options["workers"] < 0:
        raise UsageError(f"--workers {options['workers']}: must be 0 or more")
    return ServerExecutor(options["server"], os.environ.get("RTASK_TOKEN"), options["workers"])
