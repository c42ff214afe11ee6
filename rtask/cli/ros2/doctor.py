"""``rtask ros2 doctor``: say what is wrong with a machine's ROS 2, and what mends it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from rtask.cli.doctor import Finding, print_findings
from rtask.cli.options import json_option
from rtask.cli.ros.options import token_file_option, token_of
from rtask.cli.ros2.dds import domain_option
from rtask.cli.ros2.environment import Sourced, examine_environment, examine_packages
from rtask.cli.ros2.graph import examine_graph, take_survey
from rtask.cli.ros2.wheel import examine_dds
from rtask.errors import AccessError, RtaskError

__all__ = ["doctor"]

_SERVER_S = 5.0


@click.command()
@click.option(
    "--server", "url", metavar="URL", envvar="RTASK_SERVER", show_envvar=True,
    help="Also look whether this server answers.",
)  # fmt: skip
@token_file_option
@click.option(
    "--wait", "wait_s", default=3.0, show_default=True, type=click.FloatRange(min=0.1),
    help="How long to listen for nodes, s.",
)  # fmt: skip
@domain_option
@json_option
def doctor(
    url: str | None, token_file: Path | None, wait_s: float, domain: int, as_json: bool
) -> None:
    """Say what is wrong with this machine's ROS 2, and what mends it.

    Exit code 1 when something must be mended; notes do not count. Looks at the distribution, the
    RMW, the domain and the discovery, the built packages and their hashes, the server, the nodes
    and their clock, and for publishers and subscribers that do not hear each other. Run it in the
    shell in which ROS 2 is sourced. Without ROS 2 it looks at what `rtask ros2 dds` needs.
    """
    print_findings(_examine(url, token_file, wait_s, domain), quiet=False, as_json=as_json)


def _examine(
    url: str | None, token_file: Path | None, wait_s: float, domain: int
) -> Iterator[Finding]:
    from rtask.cli.ros.schema import engine_schema

    ros = Sourced()
    yield from examine_environment(ros, domain)
    if url is not None:
        yield _server(url, token_file)
    if ros:
        yield from examine_packages(ros, engine_schema())
        yield from examine_graph(take_survey(ros, domain, wait_s))
    yield from examine_dds(domain, wait_s, is_needed=not ros)


def _server(url: str, token_file: Path | None) -> Finding:
    import rtask

    try:
        token = token_of(token_file)
        with rtask.connect(url, token=token, timeout_s=_SERVER_S) as client:
            client.ask("ASK { ?s ?p ?o }")
    except AccessError as error:
        mend = "rtask token create --robot NAME on the server, and --token-file or RTASK_TOKEN here"
        return Finding("server", "broken", str(error), mend)
    except RtaskError as error:
        return Finding(
            "server", "broken", str(error), f"rtask serve, or another --server than {url}"
        )
    return Finding("server", "ok", f"answers at {url}, {'with' if token else 'without'} a token")
