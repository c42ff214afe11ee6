"""``rtask serve`` and ``rtask token``."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import data_option, json_option
from rtask.errors import UsageError

if TYPE_CHECKING:
    from endpoint.access.tokens import Token, TokenStore
    from endpoint.settings import Config
    from rtask.engine.policy import Policy

_FILE = click.Path(path_type=Path, exists=True, dir_okay=False)


class _FiniteRange(click.FloatRange):
    """A bounded number; `nan` and `inf` are none, though every comparison lets them through."""

    def convert(
        self, value: Any, parameter: click.Parameter | None, context: click.Context | None
    ) -> float:
        number = float(super().convert(value, parameter, context))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", parameter, context)
        return number


_ABOVE_ZERO = _FiniteRange(0, min_open=True)
_ZERO_OR_MORE = _FiniteRange(0)


_Decorator = Callable[[Callable[..., None]], Callable[..., None]]


def _options(*options: _Decorator) -> _Decorator:
    """Combine several options into one decorator; help lists them in this order."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


_WHERE = _options(
    click.option(
        "--config",
        type=click.Path(path_type=Path, dir_okay=False),
        is_eager=True,
        expose_value=False,
        callback=lambda *args: _use_file(*args),
        metavar="FILE",
        help="Settings in TOML, table [serve]; by default rtask.toml if it exists.",
    ),
    data_option,
    click.option(
        "--temp", is_flag=True, help="Keep everything in memory and discard it at the end."
    ),
    click.option(
        "--store", default="", metavar="URL", help="Keep the data at another SPARQL 1.1 server."
    ),
    click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on."),
    click.option(
        "-p",
        "--port",
        default=8765,
        show_default=True,
        type=click.IntRange(0, 65535),
        help="0 picks a free port.",
    ),
    click.option(
        "--public-url",
        default="",
        metavar="URL",
        help="Address under which clients reach the server.",
    ),
    click.option("--tls-cert", type=_FILE, metavar="PEM", help="Certificate, to serve HTTPS."),
    click.option("--tls-key", type=_FILE, metavar="PEM", help="Key of the certificate."),
    click.option(
        "--behind-proxy",
        is_flag=True,
        help="A proxy on this machine forwards requests; trust its X-Forwarded headers.",
    ),
    click.option(
        "--profile",
        type=click.Choice(["full", "plain"]),
        default="full",
        show_default=True,
        help="plain: a bare SPARQL 1.1 dataset without inference, provenance or rights.",
    ),
    click.option(
        "--flush",
        type=click.Choice(["commit", "os"]),
        default="commit",
        show_default=True,
        help="When a write is acknowledged: once it survives a power cut, or only a crash.",
    ),
)
_OTHERS = _options(
    click.option(
        "--cors", multiple=True, metavar="ORIGIN", help="Allow pages of this origin to read."
    ),
    click.option(
        "--allow-host",
        multiple=True,
        metavar="NAME",
        envvar="RTASK_ALLOWED_HOSTS",
        help="Accept this name of the server as Host, too.",
    ),
    click.option(
        "--allow-origin",
        multiple=True,
        metavar="ORIGIN",
        envvar="RTASK_ALLOWED_ORIGINS",
        help="Allow pages of this origin to connect and write.",
    ),
    click.option(
        "--allow-service",
        multiple=True,
        metavar="URL",
        help="Allow SERVICE to query addresses with this prefix.",
    ),
    click.option(
        "--allow-load",
        multiple=True,
        metavar="URL",
        help="Allow LOAD to read addresses with this prefix.",
    ),
)
_LIMITS = _options(
    click.option(
        "--timeout",
        default=30.0,
        show_default=True,
        type=_ABOVE_ZERO,
        help="Time limit of a query in s.",
    ),
    click.option(
        "--max-timeout",
        default=600.0,
        show_default=True,
        type=_ABOVE_ZERO,
        help="Longest limit that a client may request, in s.",
    ),
    click.option(
        "--max-upload",
        default=256,
        show_default=True,
        type=click.IntRange(1),
        metavar="MIB",
        help="Largest request body.",
    ),
    click.option(
        "--max-rows",
        default=5_000_000,
        show_default=True,
        type=click.IntRange(1),
        help="Most rows of one answer.",
    ),
    click.option(
        "--max-queries",
        default=32,
        show_default=True,
        type=click.IntRange(1),
        help="Queries that run at once; as many may wait.",
    ),
    click.option(
        "--rate",
        default=200.0,
        show_default=True,
        type=_ZERO_OR_MORE,
        help="Requests per second of one token; 0 for no limit.",
    ),
    click.option(
        "--write-rate",
        default=100.0,
        show_default=True,
        type=_ZERO_OR_MORE,
        help="Changes per second of one token; 0 for no limit.",
    ),
    click.option(
        "--limit",
        multiple=True,
        metavar="NAME=N",
        help="Bound on one SPARQL text: query_bytes, update_bytes, patterns, optionals, unions, "
        "path_steps, operations.",
    ),
)
_THRESHOLDS = _options(
    click.option(
        "--min-identity",
        default=0.7,
        show_default=True,
        type=click.FloatRange(0, 1),
        help="Least confidence in the identity of an object, for robots that ask for a decision.",
    ),
    click.option(
        "--min-pose",
        default=0.7,
        show_default=True,
        type=click.FloatRange(0, 1),
        help="Least confidence in its pose.",
    ),
    click.option(
        "--min-grasp",
        default=0.3,
        show_default=True,
        type=click.FloatRange(0, 1),
        help="Least confidence that the grasp will hold.",
    ),
)
_LOGS = _options(
    click.option(
        "--backup-dir",
        type=click.Path(path_type=Path, file_okay=False),
        metavar="DIR",
        help="Folder for backups by POST /backup; by default beside the data folder.",
    ),
    click.option(
        "--log-level",
        type=click.Choice(["debug", "info", "warning", "error"]),
        default="info",
        show_default=True,
        help="info logs one line for each request.",
    ),
    click.option("--log-queries", is_flag=True, help="Log the text of every query."),
    click.option(
        "--drain-delay",
        default=0.0,
        show_default=True,
        type=_ZERO_OR_MORE,
        help="Seconds between reporting not ready and closing the socket.",
    ),
)


def _use_file(context: click.Context, parameter: click.Parameter, file: Path | None) -> None:
    from endpoint.settings import use_file

    use_file(context, parameter, file)


@click.command(context_settings={"auto_envvar_prefix": "RTASK"})
@_WHERE
@_OTHERS
@_LIMITS
@_THRESHOLDS
@_LOGS
def serve(
    data: Path, temp: bool, store: str, port: int, flush: str, log_level: str, **options: Any
) -> None:
    """Serve a knowledge base to programs, robots and people.

    Each option can also be set by an environment variable (--max-rows by RTASK_MAX_ROWS) or in the
    settings file.
    """
    import rtask
    from endpoint import server
    from endpoint.access.tokens import TokenStore
    from endpoint.context import ServerContext
    from endpoint.monitoring.log import LineWriter, log_as_json
    from endpoint.rosbridge.services import NoEngine
    from endpoint.sparql.remote_store import EngineElsewhere, RemoteStore
    from rtask.engine import Engine

    config = _config(options)
    folder = None if temp or store else data
    with ExitStack() as stack:
        writer = stack.enter_context(closing(LineWriter()))
        log_as_json(writer, log_level)
        # Bind the port first: a second server fails before it opens a store.
        listener = stack.enter_context(closing(server.listen(config.host, port)))
        config = replace(config, host=listener.getsockname()[0])
        kb: Any
        if store:
            kb = stack.enter_context(RemoteStore(store, os.environ.get("RTASK_STORE_TOKEN")))
        else:
            where = folder or ":memory:"
            kb = stack.enter_context(rtask.open(where, plain=config.plain, flush=flush))
        tokens = stack.enter_context(closing(TokenStore(folder)))
        server.check_exposure(tokens, config)
        engine: Any = EngineElsewhere() if store else NoEngine()
        if not store and not config.plain:
            engine = stack.enter_context(Engine(kb, policy=_policy(options)))

        def ready(url: str) -> None:
            kb.publish(url=url)
            click.echo(f"ready {url} data {store or folder or 'in memory'}")

        lines = writer if log_level in ("debug", "info") else None
        context = ServerContext.create(kb, engine, tokens, config, lines)
        ended = server.serve(context, listener, ready)
        writer.close()
    if not ended:
        # Everything is stored and closed. Only threads of abandoned queries are left, and the
        # interpreter would wait for them.
        os._exit(0)


def _policy(options: dict[str, Any]) -> Policy:
    """Return the engine's policy with the thresholds that the options give."""
    from rtask.engine.policy import Policy

    return Policy(
        min_identity=options["min_identity"],
        min_pose=options["min_pose"],
        min_grasp=options["min_grasp"],
    )


def _config(options: dict[str, Any]) -> Config:
    """Return the settings that the options describe."""
    from endpoint.settings import MEGABYTE, Config, limits_of

    cert, key = options["tls_cert"], options["tls_key"]
    if bool(cert) != bool(key):
        raise UsageError("give both --tls-cert and --tls-key, or neither")
    return Config(
        host=options["host"],
        public_url=options["public_url"],
        plain=options["profile"] == "plain",
        cors=options["cors"],
        allowed_hosts=options["allow_host"],
        allowed_origins=options["allow_origin"],
        timeout_s=options["timeout"],
        max_timeout_s=max(options["timeout"], options["max_timeout"]),
        max_upload_bytes=options["max_upload"] * MEGABYTE,
        max_rows=options["max_rows"],
        max_queries=options["max_queries"],
        rate=options["rate"],
        write_rate=options["write_rate"],
        allow_service=options["allow_service"],
        allow_load=options["allow_load"],
        tls_cert=cert,
        tls_key=key,
        behind_proxy=options["behind_proxy"],
        drain_delay_s=options["drain_delay"],
        backup_dir=options["backup_dir"],
        log_queries=options["log_queries"],
        limits=limits_of(options["limit"]),
    )


@click.group()
def token() -> None:
    """Create, list and revoke access tokens."""


@token.command("create")
@data_option
@click.option("--robot", metavar="NAME", help="Robot to which the token belongs.")
@click.option("--name", metavar="NAME", help="Person to whom the token belongs.")
@click.option("--role", help="reader, robot, teacher or admin; with --robot, robot by default.")
@click.option("--expires", metavar="30d", help="Lifetime in hours, days or weeks: 12h, 30d, 4w.")
@json_option
def create(
    data: Path,
    robot: str | None,
    name: str | None,
    role: str | None,
    expires: str | None,
    as_json: bool,
) -> None:
    """Create a token and print it, this once."""
    if robot and name:
        raise UsageError("give --robot or --name, not both")
    role = role or ("robot" if robot else None)
    if role is None:
        raise UsageError("give --robot NAME, or --role reader, teacher or admin")
    from endpoint.access.tokens import parse_lifetime

    lifetime = parse_lifetime(expires, "--expires ") if expires else None
    with closing(_tokens(data, make=True)) as tokens:
        text, made = tokens.create(role, agent=robot or name, lifetime=lifetime)
    _told(data, "token-created", made.id, role=made.role, agent=made.agent, expires=made.expires)
    if as_json:
        click.echo(json.dumps({"token": text, **_members(made)}))
        return
    click.echo(text)
    click.echo(f"{_words(made)}; it is shown only now, keep it secret", err=True)


@token.command("list")
@data_option
@json_option
def list_tokens(data: Path, as_json: bool) -> None:
    """List tokens, without their secrets."""
    with closing(_tokens(data)) as tokens:
        found = tokens.all()
    if as_json:
        click.echo(json.dumps([_members(one) for one in found]))
        return
    for one in found:
        click.echo(_words(one))


@token.command("revoke")
@click.argument("token_id", metavar="ID")
@data_option
@json_option
def revoke(token_id: str, data: Path, as_json: bool) -> None:
    """Revoke a token; it gives no access from now on."""
    with closing(_tokens(data)) as tokens:
        if not tokens.revoke(token_id):
            raise UsageError(f"no token {token_id} to revoke; see rtask token list --data {data}")
    _told(data, "token-revoked", token_id)
    if as_json:
        click.echo(json.dumps({"id": token_id, "revoked": True}))
    click.echo(f"token {token_id} is revoked", err=True)


@token.command("expire")
@click.argument("token_id", metavar="ID")
@click.argument("lifetime", metavar="30d")
@data_option
@json_option
def expire(token_id: str, lifetime: str, data: Path, as_json: bool) -> None:
    """Let a token expire after a number of hours, days or weeks from now: 12h, 30d, 4w."""
    from endpoint.access.tokens import parse_lifetime

    with closing(_tokens(data)) as tokens:
        if not tokens.expire(token_id, parse_lifetime(lifetime)):
            raise UsageError(f"no token {token_id} to change; see rtask token list --data {data}")
    _told(data, "token-expires", token_id, lifetime=lifetime)
    if as_json:
        click.echo(json.dumps({"id": token_id, "lifetime": lifetime}))
    click.echo(f"token {token_id} ends in {lifetime}", err=True)


def _tokens(folder: Path, *, make: bool = False) -> TokenStore:
    import rtask
    from endpoint.access.tokens import TokenStore

    if not (folder / "kb.json").is_file():
        if not make:
            raise UsageError(f"{folder} is not a knowledge base")
        rtask.open(folder).close()
    return TokenStore(folder)


def _told(folder: Path, event: str, token_id: str, **facts: Any) -> None:
    """Record a change of a token in the audit trail."""
    from endpoint.monitoring.audit import Audit

    with closing(Audit(folder)) as audit:
        audit.event(event, token=token_id, by="command line", **facts)


def _members(one: Token) -> dict[str, str | None]:
    return {
        "id": one.id,
        "agent": one.agent,
        "role": one.role,
        "created": one.created,
        "expires": one.expires,
        "revoked": one.revoked,
    }


def _words(one: Token) -> str:
    state = f"revoked {one.revoked[:19]}" if one.revoked else f"expires {one.expires or 'never'}"
    return f"{one.id}  {one.role:8}  {one.agent or '-':16}  made {one.created[:19]}  {state}"
