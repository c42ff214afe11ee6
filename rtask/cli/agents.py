"""``rtask mcp``: the graph for an agent on this desktop, over standard input and output."""

from __future__ import annotations

import json
import os
import secrets
import select
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import click

from rtask.cli.connection import open_to_change
from rtask.cli.options import agent_option, data_option, server_option

if TYPE_CHECKING:
    import httpx

    from rtask.kb.commit.access import Access

__all__ = ["mcp"]

JsonObject = dict[str, Any]
Sent = JsonObject | list[JsonObject]
Send = Callable[[JsonObject], None]
Answerer = Callable[[JsonObject, Send], Callable[[], None]]
"""Takes a message of the agent, in their order, and returns what answers it by sending messages."""

THREADS = 8
MAX_LINE = 4 << 20
MAX_BATCH = 20
_PARSE_ERROR = -32700
_CANCELLED = "notifications/cancelled"
_LOOKS_S = 0.5
"""Time after which it is looked again whether the agent is there, s."""
_EVENTS = "text/event-stream"


@click.command()
@data_option
@server_option
@agent_option("With a folder: propose changes in the name of this robot or person.")
@click.option("--services", is_flag=True, help="With a server: the tools of its services instead.")
def mcp(data: Path, server: str | None, agent: str | None, services: bool) -> None:
    """Serve the graph to an agent over standard input and output (Model Context Protocol).

    One JSON-RPC message a line. With a server, its token is read from RTASK_TOKEN; where a server
    has the folder open already, name the server.
    """
    from rtask.errors import UsageError

    if services and not server:
        raise UsageError("--services needs --server: a folder runs no services")
    opened = _remote(server, services) if server else _embedded(data, agent)
    with opened as answer:
        serve(answer, sys.stdin.buffer, sys.stdout.buffer)


def serve(answer: Answerer, incoming: IO[bytes], outgoing: IO[bytes]) -> None:
    """Answer messages until the agent closes its end; calls run beside each other.

    All calls are given up once the agent is gone, so that nothing can be sent to it.
    """
    lock = threading.Lock()

    def send(message: Sent) -> None:
        line = json.dumps(message, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"
        with lock:
            outgoing.write(line)
            outgoing.flush()

    waiting: dict[str | None, Future[None]] = {}
    with ThreadPoolExecutor(THREADS, thread_name_prefix="agent") as pool:
        try:
            for line in _lines(incoming):
                _take(_read(line), answer, send, pool, waiting)
            while left := list(waiting.values()):
                wait(left, _LOOKS_S, FIRST_COMPLETED)
                if _is_gone(outgoing):
                    break
        except BrokenPipeError:
            pass
        for key, future in list(waiting.items()):
            future.cancel()
            params = {"requestId": json.loads(str(key))}
            answer({"jsonrpc": "2.0", "method": _CANCELLED, "params": params}, send)()


def _is_gone(outgoing: IO[bytes]) -> bool:
    """Return whether nobody reads what is sent any more."""
    try:
        poll = select.poll()
        poll.register(outgoing, 0)
    except (OSError, ValueError, TypeError, AttributeError):  # no pipe, or a system without poll
        return False
    return any(event & select.POLLERR for _, event in poll.poll(0))


def _lines(incoming: IO[bytes]) -> Iterator[bytes]:
    """Yield lines that are not blank; of one that is too long, a part that cannot be read."""
    while line := incoming.readline(MAX_LINE):
        rest = line
        while len(rest) == MAX_LINE and not rest.endswith(b"\n"):
            line, rest = b"{", incoming.readline(MAX_LINE)
        if line.strip():
            yield line


def _read(line: bytes) -> list[JsonObject] | JsonObject | None:
    """Return the message in a line, or the messages, or None if it holds none."""
    try:
        sent = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if isinstance(sent, list):
        is_batch = 1 <= len(sent) <= MAX_BATCH and all(isinstance(item, dict) for item in sent)
        return sent if is_batch else None
    return sent if isinstance(sent, dict) else None


def _take(
    sent: list[JsonObject] | JsonObject | None,
    answer: Answerer,
    send: Callable[[Sent], None],
    pool: ThreadPoolExecutor,
    waiting: dict[str | None, Future[None]],
) -> None:
    """Answer messages, or begin to: those that may take long are carried out by the pool."""
    if sent is None:
        error = {"code": _PARSE_ERROR, "message": "expected one JSON object on a line"}
        send({"jsonrpc": "2.0", "id": None, "error": error})
        return
    for message in sent if isinstance(sent, list) else (sent,):
        # A call may end, and be forgotten, at any moment.
        if (given_up := waiting.get(_cancelled(message))) is not None:
            given_up.cancel()  # unless it has begun
    if isinstance(sent, list):
        pool.submit(_answer_batch, list(sent), answer, send)
        return
    work = answer(sent, send)
    if sent.get("id") is None or sent.get("method") != "tools/call":
        _guarded(work, sent, send)
    else:
        key = json.dumps(sent["id"])
        waiting[key] = future = pool.submit(_guarded, work, sent, send)
        future.add_done_callback(partial(_forget, waiting, key))


def _answer_batch(
    messages: list[JsonObject], answer: Answerer, send: Callable[[Sent], None]
) -> None:
    """Answer several messages, one after the other, in one list (protocol 2025-03-26)."""
    answers: list[JsonObject] = []

    def collect(message: JsonObject) -> None:
        if "method" in message:
            send(message)
        else:
            answers.append(message)

    for message in messages:
        _guarded(answer(message, collect), message, collect)
    if answers:
        send(answers)


def _forget(waiting: dict[str | None, Future[None]], key: str, future: Future[None]) -> None:
    if waiting.get(key) is future:
        del waiting[key]


def _cancelled(message: JsonObject) -> str | None:
    """Return the key of the call that a notification gives up."""
    params = message.get("params")
    if message.get("method") != _CANCELLED or not isinstance(params, dict):
        return None
    return json.dumps(params.get("requestId"))


def _guarded(work: Callable[[], None], message: JsonObject, send: Send) -> None:
    """Answer a message; a fault of the program is an answer too, and says nothing of its inside."""
    try:
        work()
    except Exception as error:  # noqa: BLE001 - the agent waits for an answer
        words = f"the call failed ({type(error).__name__}); see standard error"
        click.echo(f"rtask mcp: {type(error).__name__}: {error}", err=True)
        _refuse(message, send, words)


@contextmanager
def _embedded(data: Path, agent: str | None) -> Iterator[Answerer]:
    """Yield what answers from a folder."""
    from rtask.asking.tools.protocol import answer
    from rtask.asking.tools.toolbox import Toolbox
    from rtask.engine.context import SCOPES
    from rtask.engine.engine import Engine
    from rtask.kb.commit.access import Access

    access: Access = Access(agent, "robot") if agent else Access()
    with open_to_change(data) as kb:
        engine = Engine(kb)
        try:
            toolbox = Toolbox(kb, engine, lambda access: SCOPES[access.role])
            running: dict[str, _Call] = {}

            def take(message: JsonObject, send: Send) -> Callable[[], None]:
                cancelled = _cancelled(message)
                if cancelled in running:
                    return running.pop(cancelled).stop
                if message.get("id") is None:
                    return lambda: None
                key = json.dumps(message["id"])
                call = running[key] = _Call(message, send)

                def respond() -> None:
                    try:
                        send(answer(toolbox, message, access, "rtask:", call))
                    finally:
                        running.pop(key, None)

                return respond

            yield take
        finally:
            engine.close()


class _Call:
    """A call under way: its progress goes to the agent, who may cancel it."""

    def __init__(self, message: JsonObject, send: Send) -> None:
        params = message.get("params")
        meta = params.get("_meta") if isinstance(params, dict) else None
        self._token = meta.get("progressToken") if isinstance(meta, dict) else None
        self._send = send
        self._lock = threading.Lock()
        self._stops: list[Callable[[], None]] = []
        self.is_stopped = False

    def on_stop(self, stop: Callable[[], None]) -> None:
        """Register how to stop the work; called at once if the call has been cancelled."""
        with self._lock:
            self._stops.append(stop)
            is_late = self.is_stopped
        if is_late:
            stop()

    def stop(self) -> None:
        """Cancel the call."""
        with self._lock:
            self.is_stopped = True
            stops = list(self._stops)
        for stop in stops:
            stop()

    def report(self, share: float, words: str) -> None:
        """Send progress, if the agent asked for it."""
        if self._token is None:
            return
        params = {"progressToken": self._token, "progress": share, "total": 1.0, "message": words}
        self._send({"jsonrpc": "2.0", "method": "notifications/progress", "params": params})


@contextmanager
def _remote(server: str, services: bool) -> Iterator[Answerer]:
    """Yield what passes messages on to a server."""
    import httpx

    from rtask.client.calling.messages import addresses
    from rtask.wire.address import authorization

    address, _ = addresses(server)
    url = f"{address}/mcp/services" if services else f"{address}/mcp"
    headers = {
        "Accept": f"application/json, {_EVENTS}",
        "Mcp-Session-Id": secrets.token_hex(16),
        **authorization(os.environ.get("RTASK_TOKEN")),
    }
    with httpx.Client(headers=headers, timeout=httpx.Timeout(10.0, read=None)) as client:

        def respond(message: JsonObject, send: Send) -> None:
            try:
                with client.stream("POST", url, json=message) as response:
                    _pass_on(response, message, send)
            except httpx.HTTPError as error:
                _refuse(message, send, f"the server does not answer ({type(error).__name__})")

        yield lambda message, send: partial(respond, message, send)


def _pass_on(response: httpx.Response, message: JsonObject, send: Send) -> None:
    """Send what a server answers: nothing, one message, or several as events."""
    if response.headers.get("content-type", "").startswith(_EVENTS):
        for line in response.iter_lines():
            if line.startswith("data:"):
                send(json.loads(line.removeprefix("data:")))
        return
    body = response.read()
    if response.status_code == 200:
        send(json.loads(body))
    elif response.status_code != 202:
        title = response.reason_phrase
        _refuse(message, send, f"the server refused with status {response.status_code} {title}")


def _refuse(message: JsonObject, send: Send, words: str) -> None:
    """Send an error for a request; a notification has no answer."""
    if message.get("id") is not None:
        error = {"code": -32603, "message": words}
        send({"jsonrpc": "2.0", "id": message["id"], "error": error})
