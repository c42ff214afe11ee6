"""Racing clients: the server's answer in time, else the slice's; no report is lost."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import rtask
from rtask.client.racing import RacingClient
from rtask.errors import CallFailedError, RemoteUnavailableError, UsageError
from rtask.knowledge_base import KnowledgeBase
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow

WHERE = "SELECT ?place { <urn:mug> <urn:on> ?place }"
LONG_S = 60.0


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        with rtask.connect(running.url) as client:
            client.update("INSERT DATA { <urn:mug> <urn:on> <urn:shelf> . <urn:pan> a <urn:Pan> }")
        yield running


@pytest.fixture
def slice_of_it() -> Iterator[KnowledgeBase]:
    with rtask.open(":memory:", reason=False) as kb:
        kb.update("INSERT DATA { <urn:mug> <urn:on> <urn:table> }")
        yield kb


@pytest.fixture
def silent() -> Iterator[str]:
    """A server that takes connections and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        taken: list[socket.socket] = []

        def take() -> None:
            while True:
                try:
                    taken.append(listener.accept()[0])
                except OSError:
                    return

        thread = threading.Thread(target=take, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        # First nobody may come any more: a connection taken after the others were closed stays.
        listener.shutdown(socket.SHUT_RDWR)
        thread.join()
        for one in taken:
            one.close()


@pytest.fixture
def closed() -> Iterator[str]:
    """The address of a port that nobody listens on."""
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        yield f"http://127.0.0.1:{bound.getsockname()[1]}"


def racing(url: str, kb: KnowledgeBase, **options: float) -> RacingClient:
    client = rtask.connect(url, race=True, local=kb, **options)  # type: ignore[arg-type]
    assert isinstance(client, RacingClient)
    return client


def won_by(client: RacingClient) -> tuple[str, bool]:
    assert client.last is not None
    return client.last.won_by, client.last.is_partial


def test_the_server_is_asked_first_and_its_answer_counts_in_time(server, slice_of_it):
    with racing(server.url, slice_of_it, patience_s=LONG_S, deadline_s=LONG_S) as client:
        assert client.query(WHERE) == [{"place": "urn:shelf"}]
        assert won_by(client) == ("remote", False)
        assert client.ask("ASK { <urn:pan> a <urn:Pan> }")
        with pytest.raises(CallFailedError, match="unknown object 'urn:none'"):
            client.recall_grasps(object="urn:none")  # the slice refuses it as well


def test_the_slice_answers_where_the_server_does_not(silent, slice_of_it):
    with racing(silent, slice_of_it, patience_s=0.01, deadline_s=LONG_S) as client:
        assert client.query(WHERE) == [{"place": "urn:table"}]
        assert won_by(client) == ("local", False)


def test_that_the_slice_holds_nothing_waits_for_the_server(server, slice_of_it):
    with racing(server.url, slice_of_it, patience_s=0.0, deadline_s=LONG_S) as client:
        assert client.ask("ASK { <urn:pan> a <urn:Pan> }")
        assert won_by(client) == ("remote", False)


def test_where_nobody_can_be_reached_nothing_is_the_answer_and_is_said_to_be_partial(
    closed, slice_of_it
):
    # The slice has all of the deadline for a query of an empty graph.
    with racing(closed, slice_of_it, patience_s=0.0, deadline_s=8.0) as client:
        assert client.query("SELECT ?x { <urn:pan> a ?x }") == []
        assert won_by(client) == ("local", True)


def test_more_reads_than_connections_are_answered_by_the_slice(silent, slice_of_it):
    with racing(silent, slice_of_it, patience_s=0.0, deadline_s=LONG_S) as client:
        for _ in range(12):
            assert client.query(WHERE) == [{"place": "urn:table"}]


def test_what_is_written_goes_to_the_server_and_never_to_the_slice(server, slice_of_it):
    with racing(server.url, slice_of_it, patience_s=LONG_S, deadline_s=LONG_S) as client:
        client.update("INSERT DATA { <urn:cup> <urn:on> <urn:floor> }")
        assert client.ask("ASK { <urn:cup> <urn:on> <urn:floor> }")
        assert not slice_of_it.query("ASK { <urn:cup> <urn:on> <urn:floor> }")
        assert {"rtask/Engine"} <= {one["name"] for one in client.services()}


def test_what_is_told_without_a_server_waits_in_the_outbox(closed, slice_of_it, tmp_path: Path):
    client = rtask.connect(
        closed, race=True, local=slice_of_it, timeout_s=1.0, outbox=tmp_path / "outbox",
        deadline_s=LONG_S,
    )  # fmt: skip
    with client:
        assert client.query(WHERE) == [{"place": "urn:table"}]
        with pytest.raises(RemoteUnavailableError, match="sent again later"):
            client.call("report_outcome", object="urn:mug", grasp="g", success=True)
        assert client.waiting == 1


def test_a_race_without_two_sides_is_refused(slice_of_it):
    with pytest.raises(UsageError, match="needs the address of a server, and local="):
        rtask.connect("http://127.0.0.1:1", race=True)
    with pytest.raises(UsageError, match="needs the address of a server, and local="):
        rtask.connect(slice_of_it, race=True, local=slice_of_it)
    with pytest.raises(UsageError, match="needs the address of a server, and local="):
        rtask.connect("http://127.0.0.1:1", race=True, local="http://127.0.0.1:2")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="give race=True"):
        rtask.connect("http://127.0.0.1:1", local=slice_of_it)
    with pytest.raises(UsageError, match="patience_s=2"):
        rtask.connect("http://127.0.0.1:1", race=True, local=slice_of_it, patience_s=2)
