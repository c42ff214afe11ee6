"""Put everything together and serve it until told to stop."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import resource
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import FrameType

import uvicorn

from endpoint.access.tokens import TokenStore
from endpoint.application import Gateway
from endpoint.config import Config
from endpoint.http.asgi import Front
from endpoint.http.server_protocol import GuardedProtocol
from endpoint.http.wsgi import create_app
from endpoint.monitoring.log import LineWriter
from endpoint.rosbridge.services import Engine
from endpoint.rosbridge.session import Bridge
from rtask.errors import RtaskError, UsageError
from rtask.kb.commit.commit import Change
from rtask.knowledge_base import KnowledgeBase

_log = logging.getLogger(__name__)
GRACE_S = 15
MAX_FILES = 16_384
MAX_CONNECTIONS = 8_192
THREAD_STACK_BYTES = 16 << 20


class PortInUseError(RtaskError):
    """Another program listens at the address already."""

    exit_code = 1


def listen(host: str, port: int) -> socket.socket:
    """Bind a listening socket; port 0 takes any free one.

    Raises
    ------
    PortInUseError
        Somebody else has the port.
    UsageError
        The address is not one of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # With the protocol named, asyncio switches Nagle's algorithm off; without it each answer on a
    # kept connection waits 40 ms for the client's acknowledgement.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(2048)
    except OSError as error:
        listener.close()
        if isinstance(error, socket.gaierror) or error.errno == 99:
            raise UsageError(f"cannot listen at {host}: {error.strerror}") from None
        raise PortInUseError(
            f"cannot listen at {host}:{port}: {error.strerror}; -p 0 takes a free port"
        ) from None
    return listener


@dataclass(frozen=True)
class Parts:
    """What a server is made of; `writer` takes the log's lines."""

    kb: KnowledgeBase
    engine: Engine
    tokens: TokenStore
    config: Config
    writer: LineWriter | None = None


def check_exposure(tokens: TokenStore, config: Config) -> None:
    """Refuse to be reachable from elsewhere while nobody needs a token.

    Raises
    ------
    UsageError
        Saying how to make a token.
    """
    if not config.on_loopback and not tokens.ever_issued():
        where = "behind a proxy the server" if config.behind_proxy else config.host
        raise UsageError(
            f"{where} is reachable from other machines and no token exists; make one first: "
            "rtask token create --data DIR --role admin"
        )


def serve(parts: Parts, listener: socket.socket, on_ready: Callable[[str], None]) -> bool:
    """Serve until SIGINT or SIGTERM.

    Parameters
    ----------
    parts
        Knowledge base, engine, tokens, settings. The caller closes them.
    listener
        Bound already.
    on_ready
        Called with the address once requests are answered.

    Returns
    -------
    ended
        Whether all work has ended; if not, threads of queries that took too long still run.
    """
    # Parsing nests on the stack; the threads that run queries get a deep one.
    threading.stack_size(THREAD_STACK_BYTES)
    _allow_open_files()
    host, port = listener.getsockname()[:2]
    scheme = "https" if parts.config.tls_cert else "http"
    url = f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"
    config = replace(parts.config, host=host)
    gateway = Gateway(parts.kb, parts.engine, parts.tokens, config, parts.writer)
    bridge = Bridge(parts.engine)
    pages = create_app(parts.kb, parts.engine, parts.tokens, config, gateway)
    front = Front(gateway, bridge, pages)
    settings = _settings(front, config)
    server = uvicorn.Server(settings)
    stop_announcing = parts.kb.on_commit(lambda change: _announce(bridge, change))
    # The closure is built now, not while the first robot waits for its first write.
    parts.kb.warm_up()
    gateway.audit.event("start", url=url)
    try:
        with asyncio.Runner(loop_factory=settings.get_loop_factory()) as runner:
            runner.run(_run(server, front, listener, lambda: on_ready(url)))
    finally:
        stop_announcing()
        bridge.close()
        gateway.audit.event("stop")
        ended = gateway.close()
    return ended


def _allow_open_files() -> None:
    """Ask for as many connections as the system lets this process have."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_FILES)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def _settings(front: Front, config: Config) -> uvicorn.Config:
    return uvicorn.Config(
        front,
        http=GuardedProtocol,
        log_config=None,
        access_log=False,
        server_header=False,
        lifespan="on",
        ws="websockets-sansio",
        ws_max_size=config.max_message_bytes,
        ws_ping_interval=30.0,
        # A pong cannot overtake an upload that is under way; be patient with slow links.
        ws_ping_timeout=120.0,
        ws_per_message_deflate=False,
        # What a proxy says about the client is believed where we were told of one, on this machine.
        proxy_headers=config.behind_proxy,
        forwarded_allow_ips="127.0.0.1,::1" if config.behind_proxy else "",
        ssl_certfile=config.tls_cert,
        ssl_keyfile=config.tls_key,
        limit_concurrency=MAX_CONNECTIONS,
        timeout_graceful_shutdown=GRACE_S,
        h11_max_incomplete_event_size=32 << 10,
    )


async def _run(
    server: uvicorn.Server, front: Front, listener: socket.socket, on_ready: Callable[[], None]
) -> None:
    """Run the server; robots are told to go before it waits for connections to end."""
    stopping = asyncio.Event()
    loop = asyncio.get_running_loop()

    with _signals(server, loop, stopping), _certificates(server):
        serving = asyncio.create_task(server.serve(sockets=[listener]))
        while not server.started and not serving.done():
            await asyncio.sleep(0.005)
        if server.started:
            on_ready()
        waiting = asyncio.create_task(stopping.wait())
        await asyncio.wait({serving, waiting}, return_when=asyncio.FIRST_COMPLETED)
        await _drain(server, front)
        server.should_exit = True
        await serving
        waiting.cancel()


async def _drain(server: uvicorn.Server, front: Front) -> None:
    """Say that no more work is wanted, leave a balancer time to hear it, then tell the robots."""
    front.drain()
    deadline = time.monotonic() + front.drain_delay_s
    while time.monotonic() < deadline and not server.force_exit:
        await asyncio.sleep(0.05)
    await front.changes.close_all()
    await front.connections.close_all()


@contextlib.contextmanager
def _certificates(server: uvicorn.Server) -> Iterator[None]:
    """Read the certificate again on SIGHUP: new connections get the new one."""
    settings = server.config
    if not settings.ssl_certfile or threading.current_thread() is not threading.main_thread():
        yield
        return

    def reload(number: int, frame: FrameType | None) -> None:
        try:
            assert settings.ssl is not None
            assert settings.ssl_certfile is not None
            settings.ssl.load_cert_chain(settings.ssl_certfile, settings.ssl_keyfile)
            _log.warning("certificate read again")
        except (OSError, ValueError) as error:
            _log.error("the certificate cannot be read; the old one stays: %s", error)

    before = signal.signal(signal.SIGHUP, reload)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)


@contextlib.contextmanager
def _signals(
    server: uvicorn.Server, loop: asyncio.AbstractEventLoop, stopping: asyncio.Event
) -> Iterator[None]:
    """End on the first SIGINT or SIGTERM in order, on the second at once."""

    def stop(number: int, frame: FrameType | None) -> None:
        if stopping.is_set():
            server.force_exit = True
        loop.call_soon_threadsafe(stopping.set)

    # uvicorn sets its own handlers for the time it serves; ours close the robots first.
    server.capture_signals = contextlib.nullcontext  # type: ignore[method-assign,assignment]
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _announce(bridge: Bridge, change: Change) -> None:
    """Tell robots that subscribed to `/rtask/changes` what was written."""
    bridge.topics.announce(
        "/rtask/changes",
        "rtask/Change",
        {
            "commit": change.commit.seq,
            "agent": change.agent or "",
            "graphs": sorted(getattr(graph, "value", "") for graph in change.graphs),
            "added": change.commit.added,
            "removed": change.commit.removed,
            "derived": change.commit.derived,
        },
    )
