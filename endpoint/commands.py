"""``rtask serve`` and ``rtask token``."""

from __future__ import annotations

import json
import os
import sys
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from endpoint.serve_options import config_of, policy_of, serve_options
from rtask.cli.changing.new_folder import NewFolder
from rtask.cli.options import (
    announce_undo,
    confirm_final,
    data_option,
    exit_if_empty,
    json_option,
    listing_option,
    print_json,
    resource,
    shown_rows,
    yes_option,
)
from rtask.errors import RtaskError, UnknownTermError, UsageError

if TYPE_CHECKING:
    from endpoint.access.tokens import Token, TokenStore
    from endpoint.rosbridge.services import Engine as ServedEngine
    from endpoint.served import ServedGraph
    from rtask.knowledge_base import KnowledgeBase


_NAMED = (
    ParameterSource.COMMANDLINE,
    ParameterSource.ENVIRONMENT,
    ParameterSource.DEFAULT_MAP,
)


@click.command(context_settings={"auto_envvar_prefix": "RTASK"})
@serve_options
def serve(
    data: Path,
    temp: bool,
    store: str,
    follow: str,
    token_file: Path | None,
    no_forward: bool,
    port: int,
    flush: str,
    log_level: str,
    services: tuple[str, ...],
    check_services: bool,
    lease: float,
    base: str | None,
    **options: Any,
) -> None:
    """Serve a knowledge base to programs, robots and people.

    Each option can also be set by an environment variable (--max-rows by RTASK_MAX_ROWS) or in the
    settings file.
    """
    from endpoint import server
    from endpoint.access.tokens import TokenStore
    from endpoint.context import ServerContext
    from endpoint.follow.asked_records import store_waiting
    from endpoint.follow.follower import Follower
    from endpoint.monitoring.log import LineWriter, log_as_json
    from endpoint.rosbridge.services import NoEngine
    from endpoint.sparql.remote_store import EngineElsewhere
    from rtask.engine import Engine
    from rtask.knowledge_base import KnowledgeBase
    from rtask.services.offered import open_host

    config = config_of(options)
    is_named = click.get_current_context().get_parameter_source("data") in _NAMED
    folder = None if temp or (store and not is_named) else data
    with ExitStack() as stack:
        writer = stack.enter_context(closing(LineWriter()))
        log_as_json(writer, log_level)
        # Bind the port first: a second server fails before it opens a store.
        listener = stack.enter_context(closing(server.listen(config.host, port)))
        config = replace(config, host=listener.getsockname()[0])
        engine: ServedEngine = NoEngine()
        made: Engine | None = None
        secret = token_file.read_text("utf-8").strip() if token_file is not None else None
        kb: ServedGraph
        new = stack.enter_context(NewFolder(folder)) if folder and not follow else None
        if follow:
            if base is not None:
                raise UsageError("--base: a follower has that of the server which it follows")
            kb = stack.enter_context(_copy_of(follow, secret, folder, flush))
        else:
            kb = stack.enter_context(_opened(store, folder, config.plain, flush, base))
        tokens = stack.enter_context(closing(TokenStore(kb.folder)))
        follower: Follower | None = None
        if follow and isinstance(kb, KnowledgeBase):
            follower = Follower(kb, tokens, follow, secret, not no_forward, lease_s=lease)
        else:
            server.check_exposure(tokens, config, kb.folder, store)
        if not isinstance(kb, KnowledgeBase):
            engine = EngineElsewhere()
        elif not config.plain:
            made = stack.enter_context(Engine(kb, policy=policy_of(options)))
            made.keep_compared()
            engine = made
        host = stack.enter_context(open_host(made, services))
        for problem in host.check() if check_services else ():
            click.echo(f"Warning: {problem}", err=True)

        def ready(url: str) -> None:
            kb.publish(url=url)
            if new is not None:
                new.keep()
            click.echo(f"ready {url} data {store or folder or 'in memory'}")
            if sys.stderr.isatty():
                click.echo(f"Open {url} in a browser; Ctrl-C ends the server.", err=True)

        lines = writer if log_level in ("debug", "info") else None
        context = ServerContext.create(
            kb, engine, tokens, config, lines, services=host, following=follower
        )
        if follower is not None:
            stack.callback(follower.close)
            if made is not None:
                made.context.be_copy(follower.record)
            follower.start()
        elif made is not None:
            store_waiting(made, tokens)
        ended = server.serve(context, listener, ready)
        writer.close()
    if not ended:
        # Everything is stored and closed. Only threads of abandoned queries are left, and the
        # interpreter would wait for them.
        os._exit(0)


def _opened(
    store: str, folder: Path | None, plain: bool, flush: str, base: str | None
) -> ServedGraph:
    """Open what is to be served: a folder, memory, or a SPARQL server with its own folder here."""
    import rtask
    from endpoint.sparql.remote_store import RemoteStore
    from rtask.kb.maintenance.replica import followed_by
    from rtask.knowledge_base import KnowledgeBase

    url = followed_by(folder) if folder is not None else None
    if url is not None:
        raise UsageError(
            f"{folder} follows {url}: rtask serve --follow {url} -d {folder}, or let it become "
            f"independent: rtask promote {folder}"
        )
    if not store:
        return _open_folder(folder, plain, flush, base)
    token = os.environ.get("RTASK_STORE_TOKEN")
    if not plain:
        opened: object = rtask.open(store, token=token, folder=folder, base=base)
        if isinstance(opened, KnowledgeBase):
            return opened
    return RemoteStore(store, token)


def _open_folder(folder: Path | None, plain: bool, flush: str, base: str | None) -> KnowledgeBase:
    """Open a folder, or memory for ``None``; for reading only while the folder's disk is full."""
    import rtask
    from rtask.kb.durability.disk_space import full_disk, means_full

    try:
        return rtask.open(folder or ":memory:", base=base, plain=plain, flush=flush)
    except (RtaskError, OSError, RuntimeError) as error:
        if folder is None or not means_full(error):
            raise
        try:
            kb = rtask.open(folder, mode="r", plain=plain)
        except RtaskError:
            raise error from None
    full = full_disk(folder, "to write; make room, and start the server again")
    kb.refuse_writes(full)
    click.echo(f"Warning: {full}. Until then it serves reads only.", err=True)
    return kb


def _copy_of(url: str, token: str | None, folder: Path | None, flush: str) -> KnowledgeBase:
    """Open the copy of a server's knowledge base, which is fetched if it is not there."""
    import rtask
    from endpoint.follow.follower import prepare

    if folder is None:
        raise UsageError("a follower needs a folder: -d DIR")
    prepare(folder, url, token)
    return rtask.open(folder, flush=flush, reason=False, ontologies=False)


@click.group()
def token() -> None:
    """Create, list and revoke access tokens."""


@token.command("create")
@data_option
@click.option(
    "--store",
    default="",
    metavar="URL",
    help="With a new folder: the SPARQL server that will keep its statements (`serve --store`).",
)
@click.option("--robot", metavar="NAME", help="Robot to which the token belongs.")
@click.option("--name", metavar="NAME", help="Person to whom the token belongs.")
@click.option("--role", help="reader, robot, teacher or admin; with --robot, robot by default.")
@click.option("--expires", metavar="30d", help="Lifetime in hours, days or weeks: 12h, 30d, 4w.")
@click.option(
    "--right",
    "rights",
    multiple=True,
    metavar="RIGHT",
    help="What it allows beyond its role: rules, to change rules of the reasoner; schema, to state "
    "axioms about terms of others; replicate, to copy everything, as a follower does; deploy, to "
    "carry out calls of services, as a worker does. For a reader: read:<IRI>, to read that named "
    "graph and no other but those it has the same right for; without any, it reads all. The IRI "
    "may be in any form that commands print, such as read:kb:graph/shared.",
)
@json_option
def create(
    data: Path,
    store: str,
    robot: str | None,
    name: str | None,
    role: str | None,
    expires: str | None,
    rights: tuple[str, ...],
    as_json: bool,
) -> None:
    """Create a token and print it, this once."""
    if robot and name:
        raise UsageError("give --robot or --name, not both")
    role = role or ("robot" if robot else None)
    if role is None:
        raise UsageError("give --robot NAME, or --role reader, teacher or admin")
    from endpoint.access.lifetimes import parse_lifetime

    lifetime = parse_lifetime(expires, "--expires ") if expires else None
    with NewFolder(data) as new, closing(_tokens(data, make=True, store=store)) as tokens:
        granted = [_right(text, data) for text in rights]
        text, made = tokens.create(role, agent=robot or name, lifetime=lifetime, rights=granted)
        new.keep()
    facts = {"role": made.role, "agent": made.agent, "expires": made.expires}
    _audit(data, "token-created", made.id, **facts, rights=list(made.rights))
    if as_json:
        click.echo(json.dumps({"token": text, **_members(made)}))
        return
    click.echo(text)
    click.echo(f"{_words(made)}; it is shown only now, keep it secret", err=True)
    announce_undo("token", "revoke", made.id)


@token.command("list")
@data_option
@listing_option
@json_option
def list_tokens(data: Path, limit: int | None, as_json: bool) -> None:
    """List tokens, without their secrets. Exit code 1 if there are none."""
    with closing(_tokens(data)) as tokens:
        listed = shown_rows(tokens.all(), limit, as_json)
    if as_json:
        print_json([_members(token) for token in listed])
    for token in [] if as_json else listed:
        click.echo(_words(token))
    exit_if_empty(listed, "no tokens yet; `rtask token create` makes one")


@token.command("revoke")
@click.argument("token_id", metavar="ID")
@data_option
@yes_option
@json_option
def revoke(token_id: str, data: Path, yes: bool, as_json: bool) -> None:
    """Revoke a token; it gives no access from now on."""
    confirm_final("a token stays revoked; `rtask token create` makes another", yes)
    with closing(_tokens(data)) as tokens:
        if not tokens.revoke(token_id):
            raise UsageError(f"no token {token_id} to revoke; see rtask token list --data {data}")
    _audit(data, "token-revoked", token_id)
    if as_json:
        click.echo(json.dumps({"id": token_id, "revoked": True}))
    click.echo(f"token {token_id} is revoked", err=True)


@token.command("expire")
@click.argument("token_id", metavar="ID")
@click.argument("lifetime", metavar="30d|TIME|never")
@data_option
@json_option
def expire(token_id: str, lifetime: str, data: Path, as_json: bool) -> None:
    """Let a token expire after a number of hours, days or weeks from now: 12h, 30d, 4w.

    Or at a TIME of ISO 8601, such as 2027-01-31T12:00:00Z, or never.
    """
    from endpoint.access.lifetimes import parse_expiry

    with closing(_tokens(data)) as tokens:
        before = next((token.expires for token in tokens.all() if token.id == token_id), None)
        if not tokens.expire_at(token_id, parse_expiry(lifetime)):
            raise UsageError(f"no token {token_id} to change; see rtask token list --data {data}")
    _audit(data, "token-expires", token_id, lifetime=lifetime)
    if as_json:
        click.echo(json.dumps({"id": token_id, "lifetime": lifetime}))
    else:
        ends = f"in {lifetime}" if lifetime[-1] in "hdw" else lifetime
        click.echo(f"token {token_id} ends {ends}", err=True)
        announce_undo("token", "expire", token_id, before or "never")


def _tokens(folder: Path, *, make: bool = False, store: str = "") -> TokenStore:
    import rtask
    from endpoint.access.tokens import TokenStore
    from rtask.kb.durability.settings import Settings

    if not (folder / "kb.json").is_file():
        if not make:
            Settings.load(folder)  # says that this is none, as every other command does
        if store:
            token = os.environ.get("RTASK_STORE_TOKEN")
            rtask.open(store, token=token, folder=folder).close()
        else:
            rtask.open(folder).close()
    elif store and Settings.load(folder).store is None:
        raise UsageError(f"{folder} keeps its statements itself, not at {store}; name a new folder")
    return TokenStore(folder)


def _right(text: str, folder: Path) -> str:
    """Return a right; the IRI of a graph to read may be in any form that commands print."""
    name, colon, graph = text.partition(":")
    if name != "read" or not graph.strip():
        return text
    from rtask.kb.durability.settings import Settings

    try:
        return f"{name}{colon}{resource(graph, Settings.load(folder).base)}"
    except (UsageError, UnknownTermError) as error:
        raise UsageError(f"--right {text}: {error}") from error


def _audit(folder: Path, event: str, token_id: str, **facts: Any) -> None:
    """Record a change of a token in the audit trail."""
    from endpoint.monitoring.audit import Audit

    with closing(Audit(folder)) as audit:
        audit.event(event, token=token_id, by="command line", **facts)


def _members(token: Token) -> dict[str, Any]:
    return {
        "id": token.id,
        "agent": token.agent,
        "role": token.role,
        "created": token.created,
        "expires": token.expires,
        "revoked": token.revoked,
        "rights": list(token.rights),
    }


def _words(token: Token) -> str:
    state = (
        f"revoked {token.revoked[:19]}" if token.revoked else f"expires {token.expires or 'never'}"
    )
    rights = f"  may {', '.join(token.rights)}" if token.rights else ""
    agent = token.agent or "-"
    return f"{token.id}  {token.role:8}  {agent:16}  made {token.created[:19]}  {state}{rights}"
