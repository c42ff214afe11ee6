"""A real server on a real port, for real clients."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from tests.commands import run_command
from tests.servers import RunningServer, running_server

MakeToken = Callable[..., str]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """A server without tokens: everybody on this machine may read and write.

    Each file of tests has its own, so that none meets what another has stored.
    """
    with running_server(tmp_path_factory.mktemp("open") / "store") as running:
        yield running


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """A server for which tokens are made."""
    with running_server(tmp_path_factory.mktemp("guarded") / "store") as running:
        yield running


@pytest.fixture(scope="module")
def make_token(guarded: RunningServer) -> MakeToken:
    """Make a token with the command line, as an operator does while the server runs."""

    def make(*options: str) -> str:
        command = ("token", "create", "--data", str(guarded.data), "--json")
        done = run_command(*command, *options, check=True)
        return str(json.loads(done.stdout)["token"])

    return make


@pytest.fixture(scope="module")
def nao_1(guarded: RunningServer, make_token: MakeToken) -> Iterator[httpx.Client]:
    """Client of the robot nao-1."""
    with robot(guarded, make_token("--robot", "nao-1")) as client:
        yield client


@pytest.fixture(scope="module")
def nao_2(guarded: RunningServer, make_token: MakeToken) -> Iterator[httpx.Client]:
    """Client of the robot nao-2."""
    with robot(guarded, make_token("--robot", "nao-2")) as client:
        yield client


def robot(server: RunningServer, token: str) -> httpx.Client:
    """Return a client that shows a token."""
    return httpx.Client(
        base_url=server.url, headers={"Authorization": f"Bearer {token}"}, timeout=60
    )


@pytest.fixture(scope="module")
def base(guarded: RunningServer) -> str:
    """IRI that starts every graph of the guarded server."""
    assert guarded.data is not None
    settings = json.loads((Path(guarded.data) / "kb.json").read_text(encoding="utf-8"))
    return str(settings["base"])


@pytest.fixture
def client(server: RunningServer) -> Iterator[httpx.Client]:
    """A program without a token."""
    with httpx.Client(base_url=server.url, timeout=60) as connected:
        yield connected
