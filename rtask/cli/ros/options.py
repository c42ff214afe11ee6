"""Options that the nodes of ROS 1 and ROS 2 have in common."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from rtask.errors import UsageError

__all__ = ["node_name_option", "outbox_option", "timeout_option", "token_file_option", "token_of"]

token_file_option: Callable[..., Any] = click.option(
    "--token-file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="File with the robot's token; else RTASK_TOKEN.",
)
node_name_option: Callable[..., Any] = click.option(
    "--name", default="rtask_node", show_default=True, help="Name of the node."
)
outbox_option: Callable[..., Any] = click.option(
    "--outbox",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File that keeps what could not be sent to the server; it is sent again later.",
)
timeout_option: Callable[..., Any] = click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(min=0.1),
    default=30.0,
    show_default=True,
    help="Longest wait for an answer of the server, s.",
)


def token_of(file: Path | None) -> str | None:
    """Return the token in a file, or else that of the environment."""
    if file is None:
        return os.environ.get("RTASK_TOKEN")
    token = file.read_text("utf-8").strip()
    if not token:
        raise UsageError(f"{file}: the file is empty; expected a token")
    return token
