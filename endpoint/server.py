"""Run a server: bind the socket, start the event loop, serve until told to stop."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import resource
import shlex
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType

import uvicorn

from endpoint.access.tokens import TokenStore
from endpoint.activity.watch import watch
from endpoint.application import Application
from endpoint.asgi import AsgiApplication
from endpoint.context import ServerContext
from endpoint.direct import DirectProtocol, QuickQueries
from endpoint.rosbridge.activity_topic import announce_activity
from endpoint.rosbridge.session import Bridge
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.errors import RtaskError, UsageError
from rtask.kb.commit.commit import Change

_log = logging.getLogger(__name__)
GRACE_S = 15
QUERY_GRACE_S = 2.0
MAX_FILES = 16_384
MAX_CONNECTIONS = 8_192
THREAD_STACK_BYTES = 16 << 20


class PortInUseError(RtaskError):
    """Another program is already listening at the address."""


def listen(host: str, port: int) -> socket.socket:
    """Bind a listening socket; port 0 picks a free one.

    Raises
    ------
    PortInUseError
        Another program uses the port.
    UsageError
        The address is not one of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # asyncio disables Nagle's algorithm only if the protocol is named; otherwise each answer on a
    # kept-alive connection waits 40 ms for the client's acknowledgement.
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


def check_exposure(
    tokens: TokenStore, config: Config, folder: Path | None, store: str = ""
) -> None:
    """Refuse to serve other machines while no token is required.

    Parameters
    ----------
    folder
        Where the tokens are; None for a server in memory, which has none.
    store
        Address of the SPARQL server that holds the statements; empty if the folder does.

    Raises
    ------
    UsageError
        The message says how to create a token.
    """
    if not config.on_loopback and not tokens.ever_issued():
        where = "behind a proxy the server" if config.behind_proxy else config.host
        remedy = "serve a folder, not memory"
        if folder is not None:
            where_to = f"--data {shlex.quote(str(folder))}"
            if store:  # a folder that was new is gone, and is to be made for this store again
                where_to = f"--store {shlex.quote(store)} {where_to}"
            remedy = f"create one first: rtask token create {where_to} --role admin"
        raise UsageError(f"{where} is reachable from other machines and no token exists; {remedy}")


def serve(context: ServerContext, listener: socket.socket, on_ready: Callable[[str], None]) -> bool:
    """Serve until SIGINT or SIGTERM.

    Parameters
    ----------
    context
        The parts of the server. Knowledge base, engine and tokens stay open: the caller closes
        them.
    listener
        A bound socket.
    on_ready
        Called with the address of the server once it answers requests.

    Returns
    -------
    ended
        Whether all work has ended; if not, threads of abandoned queries are still running.
    """
    # The parsers recurse, so the threads that run queries get a deep stack.
    threading.stack_size(THREAD_STACK_BYTES)
    _allow_open_files()
    host, port = listener.getsockname()[:2]
    scheme = "https" if context.config.tls_cert else "http"
    url = f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"
    application = Application(context)
    bridge = Bridge(context.engine, activity=context.activity, host=context.services)
    asgi = AsgiApplication(application, bridge, create_app(application))
    settings = _uvicorn_settings(asgi, context.config)
    server = uvicorn.Server(settings)
    announced = contextlib.ExitStack()
    announced.callback(context.kb.on_commit(lambda change: _announce(bridge, change)))
    announced.callback(context.activity.listen(lambda event: announce_activity(bridge, event)))
    announced.callback(watch(context.activity, context.kb, context.engine))
    # Build the closure now, not while the first robot waits for its first write.
    context.kb.warm_up()
    _spare_collector()
    context.audit.event("start", url=url)
    try:
        with asyncio.Runner(loop_factory=settings.get_loop_factory()) as runner:
            runner.run(_run(server, asgi, listener, lambda: on_ready(url)))
    finally:
        announced.close()
        bridge.close()
        context.audit.event("stop")
        ended = application.close()
    return ended


def _spare_collector() -> None:
    """Let the collector of reference cycles leave alone what is there now, such as the closure.

    To look at all of it takes .1 s, in which nobody is answered; at the end of the process as well.
    """
    gc.collect()
    gc.freeze()


def _allow_open_files() -> None:
    """Raise the limit of open files as far as the system allows, for many connections."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = MAX_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_FILES)
    if soft != resource.RLIM_INFINITY and soft < limit:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))


def _uvicorn_settings(asgi: AsgiApplication, config: Config) -> uvicorn.Config:
    queries = QuickQueries(asgi.application, asgi.points)
    return uvicorn.Config(
        asgi,
        http=partial(DirectProtocol, asgi=asgi, queries=queries),  # type: ignore[arg-type]
        log_config=None,
        access_log=False,
        server_header=False,
        lifespan="on",
        ws="websockets-sansio",
        ws_max_size=config.max_message_bytes,
        ws_ping_interval=30.0,
        # A pong cannot overtake an upload in progress; be patient with slow links.
        ws_ping_timeout=120.0,
        ws_per_message_deflate=False,
        # The headers of a proxy are trusted only if we were told of one, on this machine.
        proxy_headers=config.behind_proxy,
        forwarded_allow_ips="127.0.0.1,::1" if config.behind_proxy else "",
        ssl_certfile=config.tls_cert,
        ssl_keyfile=config.tls_key,
        limit_concurrency=MAX_CONNECTIONS,
        timeout_graceful_shutdown=GRACE_S,
        h11_max_incomplete_event_size=32 << 10,
    )


async def _run(
    server: uvicorn.Server,
    asgi: AsgiApplication,
    listener: socket.socket,
    on_ready: Callable[[], None],
) -> None:
    """Run the server; at its end, disconnect the robots before waiting for open connections."""
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
        await _drain(server, asgi)
        server.should_exit = True
        no_longer = loop.call_later(QUERY_GRACE_S, asgi.stop_queries)
        await serving
        no_longer.cancel()
        asgi.points.close()
        waiting.cancel()


async def _drain(server: uvicorn.Server, asgi: AsgiApplication) -> None:
    """Report "not ready", give load balancers time to notice, then disconnect the robots."""
    asgi.drain()
    deadline = time.monotonic() + asgi.drain_delay_s
    while time.monotonic() < deadline and not server.force_exit:
        await asyncio.sleep(0.05)
    await asgi.changes.close_all()
    await asgi.connections.close_all()


@contextlib.contextmanager
def _certificates(server: uvicorn.Server) -> Iterator[None]:
    """Reload the certificate on SIGHUP, for new connections."""
    settings = server.config
    if not settings.ssl_certfile or threading.current_thread() is not threading.main_thread():
        yield
        return

    def reload(number: int, frame: FrameType | None) -> None:
        try:
            assert settings.ssl is not None
            assert settings.ssl_certfile is not None
            settings.ssl.load_cert_chain(settings.ssl_certfile, settings.ssl_keyfile)
            _log.warning("certificate reloaded")
        except (OSError, ValueError) as error:
            _log.error("cannot read the certificate, keeping the old one: %s", error)

    before = signal.signal(signal.SIGHUP, reload)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, before)


@contextlib.contextmanager
def _signals(
    server: uvicorn.Server, loop: asyncio.AbstractEventLoop, stopping: asyncio.Event
) -> Iterator[None]:
    """Stop gracefully on the first SIGINT or SIGTERM, and at once on the second."""

    def stop(number: int, frame: FrameType | None) -> None:
        if stopping.is_set():
            server.force_exit = True
        loop.call_soon_threadsafe(stopping.set)

    # Replace uvicorn's own handlers: ours disconnect the robots first.
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
    """Publish a commit to the robots that subscribed to `/rtask/changes`."""
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
