"""Options of ``rtask serve``, and the settings that they describe."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.options import data_option
from rtask.errors import UsageError

if TYPE_CHECKING:
    from endpoint.settings import Config
    from rtask.engine.policy import Policy

__all__ = ["config_of", "policy_of", "serve_options"]

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
_SHARE = _FiniteRange(0, 1)


_Decorator = Callable[[Callable[..., None]], Callable[..., None]]


def _options(*options: _Decorator) -> _Decorator:
    """Combine several options into one decorator; help lists them in this order."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def _number(
    name: str, default: float, range_: click.ParamType[Any], help_: str, metavar: str | None = None
) -> _Decorator:
    """Return an option that takes a number and shows its default."""
    return click.option(
        name, default=default, show_default=True, type=range_, help=help_, metavar=metavar
    )


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
        "--base",
        metavar="IRI",
        help="What the IRIs of individuals begin with, in a new folder or --temp; default: random.",
    ),
    click.option(
        "--store",
        default="",
        metavar="URL",
        help="Keep the statements at a SPARQL 1.1 server, and the rest in --data.",
    ),
    click.option(
        "--follow", default="", metavar="URL", help="Keep a copy of what this server serves."
    ),
    click.option(
        "--token-file", type=_FILE, metavar="FILE", help="Token with the right replicate there."
    ),
    click.option(
        "--no-forward", is_flag=True, help="Redirect writes to the server that is followed."
    ),
    click.option(
        "--lease",
        type=click.FloatRange(min=0),
        default=60.0,
        show_default=True,
        metavar="S",
        help="A follower lets no token in after this time without contact, s; 0 = always.",
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
        "--service",
        "services",
        multiple=True,
        metavar="MODULE|FILE.py",
        help="Offer the services that this module or file defines; repeat for several.",
    ),
    click.option(
        "--check-services",
        is_flag=True,
        help="Start each service once before the first request, and say which ones fail.",
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
    _number("--timeout", 30.0, _ABOVE_ZERO, "Time limit of a query in s."),
    _number("--max-timeout", 600.0, _ABOVE_ZERO, "Longest limit that a client may request, in s."),
    _number("--max-upload", 256, click.IntRange(1), "Largest request body.", metavar="MIB"),
    _number("--max-rows", 5_000_000, click.IntRange(1), "Most rows of one answer."),
    _number("--max-queries", 32, click.IntRange(1),
            "Queries that run at once; as many may wait."),
    _number("--max-change", 5_000, click.IntRange(1),
            "Most statements that one change of a robot or teacher adds or removes."),
    _number("--rate", 200.0, _ZERO_OR_MORE,
            "Requests per second of one token; 0 for no limit."),
    _number("--write-rate", 100.0, _ZERO_OR_MORE,
            "Requests per second of one token that change or record something; 0 for no limit."),
    click.option(
        "--no-cache", is_flag=True, help="Evaluate every query, even if nothing was written since."
    ),
    click.option(
        "--limit",
        multiple=True,
        metavar="NAME=N",
        help="Bound on one SPARQL text: query_bytes, update_bytes, patterns, optionals, unions, "
        "path_steps, operations.",
    ),
)  # fmt: skip
_THRESHOLDS = _options(
    _number("--min-identity", 0.7, _SHARE, "Least confidence in the identity of an object, for "
            "robots that ask for a decision."),
    _number("--min-pose", 0.7, _SHARE, "Least confidence in its pose."),
    _number("--min-grasp", 0.3, _SHARE, "Least confidence that the grasp will hold."),
    _number("--clock-ahead", 300.0, _ZERO_OR_MORE, "How far the clock of a robot may be ahead, s; "
            "beyond it, the time of receipt is stored."),
)  # fmt: skip
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
    click.option(
        "--propose-axioms", is_flag=True,
        help="Keep changes that are refused for lack of the right schema as proposals.",
    ),
    click.option("--log-queries", is_flag=True, help="Log the text of every query."),
    _number("--drain-delay", 0.0, _ZERO_OR_MORE,
            "Seconds between reporting not ready and closing the socket."),
)  # fmt: skip


def _use_file(context: click.Context, parameter: click.Parameter, file: Path | None) -> None:
    from endpoint.settings import use_file

    use_file(context, parameter, file)


def policy_of(options: dict[str, Any]) -> Policy:
    """Return the engine's policy with the thresholds that the options give."""
    from rtask.engine.policy import Policy

    return Policy(
        min_identity=options["min_identity"],
        min_pose=options["min_pose"],
        min_grasp=options["min_grasp"],
        clock_ahead_s=options["clock_ahead"],
    )


def config_of(options: dict[str, Any]) -> Config:
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
        max_change=options["max_change"],
        rate=options["rate"],
        write_rate=options["write_rate"],
        allow_service=options["allow_service"],
        allow_load=options["allow_load"],
        tls_cert=cert,
        tls_key=key,
        behind_proxy=options["behind_proxy"],
        drain_delay_s=options["drain_delay"],
        backup_dir=options["backup_dir"],
        propose_axioms=options["propose_axioms"],
        log_queries=options["log_queries"],
        cache=not options["no_cache"],
        limits=limits_of(options["limit"]),
    )


serve_options = _options(_WHERE, _OTHERS, _LIMITS, _THRESHOLDS, _LOGS)
