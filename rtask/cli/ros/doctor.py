"""``rtask ros doctor``: say what is wrong with a machine's ROS 1, and what mends it."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator

import click

from rtask.cli.doctor import Finding, print_findings
from rtask.errors import RtaskError

__all__ = ["doctor"]

_HEARD_S = 5.0
_ADDRESS = "export ROS_IP to the address of this machine that the others can reach"


@click.command()
@click.option(
    "--server",
    "url",
    metavar="URL",
    help="Also look whether this server answers.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON list.")
def doctor(url: str | None, as_json: bool) -> None:
    """Say what is wrong with this machine's ROS 1, and what mends it.

    Exit code 1 when something must be mended; notes do not count. Looks for rospy, the master, this
    machine's own address and the clock, and publishes a message that it must hear itself.
    """
    print_findings(_examine(url), quiet=False, as_json=as_json)


def _examine(url: str | None) -> Iterator[Finding]:
    from rtask.interop.ros.find import use_ros
    from rtask.interop.ros.master import Master

    if url is not None:
        yield _server(url)
    try:
        ros = use_ros()
    except RtaskError as error:
        yield Finding("rospy", "broken", *_parted(error))
        return
    yield Finding("rospy", "ok", f"{ros.version} in {ros.packages}")
    address = _address()
    yield address
    try:
        master = Master()
        master.ask("getPid")
    except RtaskError as error:
        yield Finding("master", "broken", str(error), "roscore &")
        return
    yield Finding("master", "ok", f"answers at {master.uri}")
    try:
        is_simulated = bool(master.ask("getParam", "/use_sim_time"))
    except RtaskError:
        is_simulated = False
    publishers = [names for topic, names in master.ask("getSystemState")[0] if topic == "/clock"]
    if is_simulated and not publishers:
        yield Finding(
            "clock", "broken", "/use_sim_time is set and nobody publishes /clock",
            "start the simulator, or rosparam set use_sim_time false",
        )  # fmt: skip
        return
    yield Finding("clock", "ok", "/clock" if is_simulated else "the clock of this machine")
    if address.state != "broken":
        yield _hearing()


def _server(url: str) -> Finding:
    import rtask

    try:
        with rtask.connect(url, token=os.environ.get("RTASK_TOKEN"), timeout_s=5) as client:
            client.ask("ASK { ?s ?p ?o }")
    except RtaskError as error:
        return Finding(
            "server", "broken", str(error), f"rtask serve, or another --server than {url}"
        )
    return Finding("server", "ok", f"answers at {url}")


def _parted(error: RtaskError) -> tuple[str, str]:
    """Return an error and the command that mends it, which follows the last colon."""
    words, _, command = str(error).rpartition(": ")
    return (words, command) if command.startswith("apt-get") else (str(error), "")


def _address() -> Finding:
    """Look whether the name under which other nodes find this machine is one of its own."""
    named = os.environ.get("ROS_HOSTNAME") or os.environ.get("ROS_IP")
    host = named or socket.gethostname()
    where = "ROS_HOSTNAME or ROS_IP" if named else "the name of this machine"
    try:
        resolved = socket.gethostbyname(host)
    except OSError as error:
        return Finding("own address", "broken", f"{host} ({where}): {error.strerror}", _ADDRESS)
    with socket.socket() as probe:
        try:
            probe.bind((resolved, 0))
        except OSError as error:
            words = f"{host} ({where}) is {resolved}, not this machine: {error.strerror}"
            return Finding("own address", "broken", words, _ADDRESS)
    if resolved.startswith("127."):
        words = f"{host} ({where}) is {resolved}: nodes on other machines cannot reach it"
        return Finding("own address", "note", words, _ADDRESS)
    return Finding("own address", "ok", f"{host} is {resolved}")


def _hearing() -> Finding:
    """Publish a message and hear it, through the master and a socket as other nodes would."""
    from rtask.interop.ros.master import hears_itself

    if hears_itself(_HEARD_S):
        return Finding("topics", "ok", "a message that was published was heard")
    words = f"a message that was published was not heard within {_HEARD_S:g} s"
    return Finding("topics", "broken", words, f"look for a firewall; {_ADDRESS}")
