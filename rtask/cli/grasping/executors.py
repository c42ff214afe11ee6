"""``--executor``: where the work of a plan runs, the same option for every command."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

import click

from rtask.errors import UsageError

if TYPE_CHECKING:
    from grasp.push.shards import Executor

__all__ = ["ExecutorName", "executor_options", "open_named"]

ExecutorName = Literal["serial", "threads", "processes", "server", "ray"]
F = TypeVar("F", bound=Callable[..., Any])


def executor_options(what: str) -> Callable[[F], F]:
    """Add the options of :func:`open_named` to a command.

    Parameters
    ----------
    what
        What runs, for the help.
    """
    options = [
        click.option(
            "--executor",
            type=click.Choice(get_args(ExecutorName)),
            default="serial",
            show_default=True,
            help=f"Where {what} run. server: on that of --server and the workers connected to it; "
            "ray: on the running cluster of --cluster.",
        ),
        click.option(
            "--server",
            metavar="URL",
            envvar="RTASK_SERVER",
            show_envvar=True,
            help="URL of --executor server. Its token is read from RTASK_TOKEN.",
        ),
        click.option(
            "--cluster",
            metavar="ADDRESS",
            help="Ray cluster that is running, or auto for the one of this machine.",
        ),
        click.option(
            "--workers",
            default=0,
            type=click.IntRange(min=0),
            help="Number of workers; 0 = one for each core, of a server eight calls at a time.",
        ),
    ]

    def add(command: F) -> F:
        for option in reversed(options):
            command = option(command)
        return command

    return add


def open_named(
    name: ExecutorName, server: str | None, cluster: str | None, workers: int
) -> Executor:
    """Return what the options name; a context manager.

    Raises
    ------
    UsageError
        ``--executor server`` without a server.
    ValueError
        No such cluster.
    """
    from grasp.push import open_executor

    if name != "server":
        return open_executor(name, workers, cluster)
    from rtask.client.trials import ServerExecutor

    if not server:
        raise UsageError("--executor server needs --server URL")
    return ServerExecutor(server, os.environ.get("RTASK_TOKEN"), workers)
