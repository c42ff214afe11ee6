"""A program follows the graph, near and far, and through a server's restart."""

from __future__ import annotations

import itertools
import signal
import socket
import threading
from pathlib import Path

import httpx
import pytest

import rtask
from rtask.client.following import Pattern, follow_remote
from rtask.errors import CallFailedError, EpochChangedError, RemoteUnavailableError, UsageError
from tests.servers import running_server


def insert(client, *numbers, subject="urn:s"):
    for number in numbers:
        client.update(f"INSERT DATA {{ GRAPH <urn:g> {{ <{subject}> <urn:p> {number} }} }}")


def numbers(changes, count):
    taken = itertools.islice(changes, count)
    return [int(change.added[0][2].split('"')[1]) for change in taken]


def test_near_a_program_hears_what_it_follows():
    with rtask.open(":memory:", reason=False) as kb, rtask.connect(kb) as graph:
        changes = graph.follow(s="urn:s", p="<urn:p>")
        insert(graph, 1)
        insert(graph, 2, subject="urn:other")
        insert(graph, 3)
        first = next(changes)
        number = '"1"^^<http://www.w3.org/2001/XMLSchema#integer>'
        assert first.added == (("<urn:s>", "<urn:p>", number, "<urn:g>"),)
        assert numbers(changes, 1) == [3]
        assert numbers(graph.follow(s="urn:s", since=first.version), 1) == [3]
        assert numbers(graph.follow(o=number, since=f"{kb.feed.epoch}:{first.seq - 1}"), 1) == [1]
        with pytest.raises(UsageError, match="no term"):
            graph.follow(o='"unclosed')


@pytest.mark.slow
def test_far_nothing_is_missed_through_a_kill_and_a_restart(tmp_path: Path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    heard: list[int] = []
    both = threading.Event()

    def listen(changes):
        for change in changes:
            heard.append(int(change.added[0][2].split('"')[1]))
            if len(heard) == 4:
                both.set()
                return

    with (
        running_server(tmp_path / "store", "-p", port) as server,
        rtask.connect(server.url, timeout_s=60) as graph,
    ):
        insert(graph, 0)
        begin = f"{server_epoch(server)}:0"
        changes = graph.follow(s="urn:s", since=begin)
        thread = threading.Thread(target=listen, args=(changes,), daemon=True)
        thread.start()
        insert(graph, 1)
        server.stop(signal.SIGKILL)
        with running_server(tmp_path / "store", "-p", port) as again:
            insert(graph, 2, 3)
            assert both.wait(60)
            thread.join(60)
            foreign = graph.follow(s="urn:s", since="00000000:1")
            with pytest.raises(EpochChangedError):
                next(foreign)
            assert again.url == server.url
    assert heard == [0, 1, 2, 3]


def server_epoch(server) -> str:
    import httpx

    return str(httpx.get(f"{server.url}/health").json()["epoch"])


def test_nobody_there_is_an_error_after_the_given_time():
    with rtask.connect("http://127.0.0.1:9", timeout_s=0.3) as graph:
        changes = graph.follow()
        with pytest.raises(RemoteUnavailableError):
            next(changes)


def test_a_large_change_that_is_no_longer_kept_is_an_error_in_the_servers_words():
    def serve(request: httpx.Request) -> httpx.Response:
        if request.url.path == "/changes":
            event = 'event: change\nid: e:1\ndata: {"truncated": true, "whole": "/changes/1"}\n\n'
            return httpx.Response(200, text=event)
        return httpx.Response(410, json={"detail": "commit 1 is no longer kept"})

    session = httpx.Client(base_url="http://graph", transport=httpx.MockTransport(serve))
    with session, pytest.raises(CallFailedError, match="commit 1 is no longer kept"):
        next(follow_remote(lambda: session, Pattern(), None, 1.0))
