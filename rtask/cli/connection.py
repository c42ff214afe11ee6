"""Commands that talk to an engine: one in this process over a folder, or one behind a server."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rtask.client import Client

__all__ = ["connection", "server_option"]

server_option = click.option(
    "--server",
    metavar="URL",
    envvar="RTASK_SERVER",
    help="Ask a server instead of a folder; its token is taken from RTASK_TOKEN.",
)


@contextmanager
def connection(data: Path, server: str | None, agent: str | None = None) -> Iterator[Client]:
    """Yield a client of the server, or of an engine over the folder.

    Parameters
    ----------
    agent
        Over a folder: the robot on whose behalf it asks. A server knows it from the token.
    """
    import rtask

    if server:
        with rtask.connect(server, token=os.environ.get("RTASK_TOKEN")) as client:
            yield client
        return
    with rtask.open(data) as kb, rtask.connect(kb, agent=agent) as client:
        yield client
