"""Settings of a server, and how ``rtask serve`` reads them from a file.

An option of the command line wins over its environment variable, and that over the settings file.
The file's members are the long options without their dashes, in a table ``[serve]``::

    [serve]
    host = "0.0.0.0"
    timeout = 60
    allow-service = ["https://dbpedia.org/sparql"]
    limit = ["patterns=256"]
"""

from __future__ import annotations

import dataclasses
import difflib
import ipaddress
import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import click

from rtask.errors import UsageError

MEGABYTE = 1 << 20
DEFAULT_FILE = Path("rtask.toml")
TABLE = "serve"
# The longest timeout that a caller of a role may request; for other roles, the server's limit.
ROLE_TIMEOUT_S = {"reader": 30.0, "robot": 30.0, "teacher": 60.0}


@dataclass(frozen=True)
class Limits:
    """Bounds on the text of one SPARQL request."""

    query_bytes: int = 1 << 20
    update_bytes: int = 64 << 20
    patterns: int = 128
    optionals: int = 64
    unions: int = 256
    path_steps: int = 100
    operations: int = 1_000


@dataclass(frozen=True)
class Config:
    """Settings of one server.

    Parameters
    ----------
    host
        Address to which the server is bound.
    public_url
        Scheme and authority under which clients reach the server; empty to take them from each
        request.
    plain
        Serve a bare SPARQL 1.1 dataset without inference, provenance or access rights.
    cors
        Origins whose pages may read and, when listed by name, write; ``*`` allows reads only.
    allowed_hosts, allowed_origins
        Names and origins accepted in addition to the server's own.
    timeout_s
        Time limit of a query whose client names none.
    max_timeout_s
        The longest limit that a client may request.
    write_timeout_s
        Time limit of the WHERE parts of an update; for an admin, `max_timeout_s`.
    max_upload_bytes
        Largest request body, before and after decompression.
    max_message_bytes
        Largest websocket message.
    max_rows, max_result_bytes
        Where the answer to a query is cut off.
    max_queries
        Queries of all callers that run at once; as many again may wait.
    max_change
        Statements that one change of a robot or teacher may add or remove. Nobody else writes
        while it is stored, some 15 us of processor time for each.
    rate, write_rate
        Requests and changes per second allowed to one token or, without a token, one address;
        bursts may be twice as large. Zero means no limit. Local callers are not limited while no
        token is required.
    max_in_flight
        Requests of one token in progress at the same time.
    allow_service, allow_load
        Address prefixes that ``SERVICE`` and ``LOAD`` may reach; all others are refused.
    tls_cert, tls_key
        PEM files; reloaded on SIGHUP.
    behind_proxy
        A proxy on this machine forwards the requests of others: its X-Forwarded headers are
        trusted, and local callers have no privileges.
    drain_delay_s
        Seconds between reporting "not ready" and closing the listening socket.
    backup_dir
        Folder for backups; by default beside the data folder.
    propose_axioms
        Keep changes that are refused for lack of the right ``schema`` as proposals.
    log_queries
        Log the text of every query, not only of slow ones.
    cache
        Keep small answers until the next commit, to answer equal requests from memory.
    limits
        Bounds on one SPARQL text.
    """

    host: str = "127.0.0.1"
    public_url: str = ""
    plain: bool = False
    cors: tuple[str, ...] = ()
    allowed_hosts: tuple[str, ...] = ()
    allowed_origins: tuple[str, ...] = ()
    timeout_s: float = 30.0
    max_timeout_s: float = 600.0
    write_timeout_s: float = 5.0
    max_upload_bytes: int = 256 * MEGABYTE
    max_message_bytes: int = 64 * MEGABYTE
    max_rows: int = 5_000_000
    max_result_bytes: int = 2048 * MEGABYTE
    max_queries: int = 32
    max_change: int = 5_000
    rate: float = 200.0
    write_rate: float = 100.0
    max_in_flight: int = 32
    allow_service: tuple[str, ...] = ()
    allow_load: tuple[str, ...] = ()
    tls_cert: Path | None = None
    tls_key: Path | None = None
    behind_proxy: bool = False
    drain_delay_s: float = 0.0
    backup_dir: Path | None = None
    propose_axioms: bool = False
    log_queries: bool = False
    cache: bool = True
    limits: Limits = field(default_factory=Limits)

    @property
    def on_loopback(self) -> bool:
        """Whether the server is reachable from this machine only."""
        return is_loopback(self.host) and not self.behind_proxy

    def site(self, scheme: str, host: str) -> str:
        """Return the scheme and authority under which a request arrived."""
        return self.public_url.rstrip("/") or f"{scheme}://{host}"

    def backups_of(self, folder: Path | None) -> Path:
        """Return the folder that holds the backups of a data folder."""
        if self.backup_dir is not None or folder is None:
            return self.backup_dir or Path("backups")
        return folder.resolve().with_name(f"{folder.resolve().name}-backups")

    def effective_timeout(self, asked_s: float | None, role: str = "admin") -> float:
        """Return the time limit of a query: the requested one, up to what the role allows."""
        allowed = self.max_timeout_s
        if role in ROLE_TIMEOUT_S:
            allowed = min(allowed, max(self.timeout_s, ROLE_TIMEOUT_S[role]))
        return min(asked_s or self.timeout_s, allowed)


@lru_cache(maxsize=256)
def is_loopback(host: str) -> bool:
    """Tell whether a host name or address means this machine only.

    Examples
    --------
    >>> [is_loopback(h) for h in ("localhost", "127.0.0.1", "::1", "0.0.0.0", "robots.lab")]
    [True, True, True, False, False]
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def read_settings(file: Path, options: Iterable[str]) -> dict[str, Any]:
    """Read the ``[serve]`` table of a file, keyed by click's parameter names.

    Parameters
    ----------
    file
        TOML.
    options
        Names of the options, spelled with dashes.

    Raises
    ------
    UsageError
        The file cannot be read, or names an unknown option.
    """
    try:
        document = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{file}: {error}") from None
    table = document.get(TABLE, {})
    if not isinstance(table, dict):
        raise UsageError(f"{file}: [{TABLE}] must be a table")
    names = set(options)
    for name in table:
        if name.replace("_", "-") not in names:
            near = difflib.get_close_matches(name.replace("_", "-"), names, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise UsageError(f"{file}: [{TABLE}] has no setting {name!r}{hint}")
    return {name.replace("-", "_"): value for name, value in table.items()}


def use_file(context: click.Context, _: click.Parameter, file: Path | None) -> Path | None:
    """Take defaults from a settings file; the callback of ``--config``."""
    if file is None and DEFAULT_FILE.is_file():
        file = DEFAULT_FILE
    if file is not None:
        options = {
            option.removeprefix("--"): parameter.name
            for parameter in context.command.params
            for option in parameter.opts
            if option.startswith("--") and parameter.name != "config"
        }
        settings = read_settings(file, options)
        names = {option.replace("-", "_"): name for option, name in options.items()}
        context.default_map = {str(names[key]): value for key, value in settings.items()}
    return file


def limits_of(settings: Iterable[str]) -> Limits:
    """Return the limits described by ``NAME=VALUE`` settings.

    Examples
    --------
    >>> limits_of(["patterns=256"]).patterns
    256

    Raises
    ------
    UsageError
        An unknown limit, or not a positive whole number.
    """
    limits = Limits()
    names = [member.name for member in dataclasses.fields(Limits)]
    for setting in settings:
        name, _, value = setting.partition("=")
        if name not in names:
            raise UsageError(f"unknown limit {name!r}; the limits are {', '.join(names)}")
        if not re.fullmatch(r"[0-9]{1,18}", value) or int(value) == 0:
            raise UsageError(f"--limit {setting}: expected a whole number above 0")
        limits = dataclasses.replace(limits, **{name: int(value)})
    return limits
