"""``rtask serve`` and ``rtask token``."""

from __future__ import annotations

import json
import logging
import os
import re
from contextlib import ExitStack, closing
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.options import data_option, json_option
from rtask.errors import UsageError

if TYPE_CHECKING:
    from endpoint.tokens import Token, TokenStore

_LIFETIME = re.compile(r"(\d+)([hdw])")
_HOURS = {"h": 1, "d": 24, "w": 168}


@click.command()
@data_option
@click.option("--temp", is_flag=True, help="Keep everything in memory; gone at the end.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at.")
@click.option("-p", "--port", default=8765, show_default=True, help="0 takes any free port.")
@click.option(
    "--profile",
    type=click.Choice(["full", "plain"]),
    default="full",
    show_default=True,
    help="plain: a bare SPARQL 1.1 dataset without inference, provenance or rights.",
)
@click.option("--public-url", default="", metavar="URL", help="Address that clients use.")
@click.option("--cors", multiple=True, metavar="ORIGIN", help="Let pages of this origin read.")
@click.option(
    "--allow-host",
    multiple=True,
    metavar="NAME",
    envvar="RTASK_ALLOWED_HOSTS",
    help="Another name of this server.",
)
@click.option(
    "--allow-origin",
    multiple=True,
    metavar="ORIGIN",
    envvar="RTASK_ALLOWED_ORIGINS",
    help="Let pages of this origin connect and write.",
)
@click.option("--timeout", default=30.0, show_default=True, help="Seconds for a query.")
@click.option("--log-level", default="warning", show_default=True, help="debug, info, warning.")
def serve(
    data: Path,
    temp: bool,
    host: str,
    port: int,
    profile: str,
    public_url: str,
    cors: tuple[str, ...],
    allow_host: tuple[str, ...],
    allow_origin: tuple[str, ...],
    timeout: float,
    log_level: str,
) -> None:
    """Serve a knowledge base: SPARQL, robots, pages."""
    import rtask
    from endpoint import server
    from endpoint.config import Config
    from endpoint.rosbridge.services import NoEngine
    from endpoint.tokens import TokenStore
    from rtask.engine import Engine

    logging.basicConfig(
        level=getattr(logging, log_level.upper(), logging.WARNING),
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
    )
    plain = profile == "plain"
    folder = None if temp else data
    config = Config(
        host=host,
        public_url=public_url,
        plain=plain,
        cors=cors,
        allowed_hosts=allow_host,
        allowed_origins=allow_origin,
        timeout_s=timeout,
    )
    with ExitStack() as stack:
        # The port comes first: who starts a second server hears of it before a store is opened.
        listener = stack.enter_context(closing(server.listen(host, port)))
        kb = stack.enter_context(rtask.open(folder or ":memory:", plain=plain))
        tokens = stack.enter_context(closing(TokenStore(folder)))
        server.check_exposure(tokens, config)
        engine = NoEngine() if plain else stack.enter_context(Engine(kb))

        def ready(url: str) -> None:
            kb.publish(url=url)
            click.echo(f"ready {url} data {folder or 'in memory'}")

        ended = server.serve(server.Parts(kb, engine, tokens, config), listener, ready)
    if not ended:
        # Everything is stored and closed; only threads of queries that took too long are left, and
        # the interpreter would wait for them.
        os._exit(0)


@click.group()
def token() -> None:
    """Make, list and revoke access tokens."""


@token.command("create")
@data_option
@click.option("--robot", metavar="NAME", help="Robot that the token speaks for.")
@click.option("--name", metavar="NAME", help="Person that the token speaks for.")
@click.option("--role", help="reader, robot, teacher or admin; robot where --robot is given.")
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
    """Make a token; its text is shown this once."""
    if robot and name:
        raise UsageError("--robot or --name, not both")
    role = role or ("robot" if robot else None)
    if role is None:
        raise UsageError("say --robot NAME, or --role with one of reader, teacher, admin")
    with closing(_tokens(data, make=True)) as tokens:
        text, made = tokens.create(role, agent=robot or name, lifetime=_lifetime(expires))
    if as_json:
        click.echo(json.dumps({"token": text, **_members(made)}))
        return
    click.echo(text)
    click.echo(f"{_words(made)}; shown this once, keep it secret", err=True)


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
def revoke(token_id: str, data: Path) -> None:
    """Revoke a token; it opens nothing from now on."""
    with closing(_tokens(data)) as tokens:
        if not tokens.revoke(token_id):
            raise UsageError(f"no token {token_id} to revoke; see rtask token list --data {data}")
    click.echo(f"token {token_id} is revoked", err=True)


def _tokens(folder: Path, *, make: bool = False) -> TokenStore:
    import rtask
    from endpoint.tokens import TokenStore

    if not (folder / "kb.json").is_file():
        if not make:
            raise UsageError(f"{folder} is not a knowledge base")
        rtask.open(folder).close()
    return TokenStore(folder)


def _lifetime(text: str | None) -> timedelta | None:
    if text is None:
        return None
    match = _LIFETIME.fullmatch(text)
    if not match:
        raise UsageError(f"--expires {text}: hours, days or weeks are wanted: 12h, 30d, 4w")
    return timedelta(hours=int(match.group(1)) * _HOURS[match.group(2)])


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
