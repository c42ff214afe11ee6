"""The files for systemd and containers say what the command understands, and nothing careless."""

from __future__ import annotations

import configparser
import json
import os
import re
import shlex
import shutil
import subprocess
import tomllib
from pathlib import Path

import click
import pytest

from endpoint.commands import serve
from rtask.cli.services.worker import worker

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "docs" / "deploy"
INSTRUCTIONS = {
    *("FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "VOLUME", "EXPOSE", "STOPSIGNAL"),
    *("HEALTHCHECK", "ENTRYPOINT", "CMD", "ARG"),
}


def unknown_options(words: list[str], command: click.Command = serve) -> list[str]:
    """Return the options of a command line that a command does not have."""
    known = {option for parameter in command.params for option in parameter.opts}
    return [word for word in words if word.startswith("-") and word.split("=")[0] not in known]


@pytest.fixture(scope="module", params=["rtask.service", "rtask-follower@.service"])
def unit(request: pytest.FixtureRequest) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=True, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(DEPLOY / request.param, encoding="utf-8")
    return parser


def test_the_unit_starts_what_there_is(unit: configparser.ConfigParser) -> None:
    program, command, *words = shlex.split(unit["Service"]["ExecStart"])
    assert (Path(program).name, command) == ("rtask", "serve")
    assert unknown_options(words) == []


def test_the_unit_runs_without_privileges_and_waits_for_the_end(
    unit: configparser.ConfigParser,
) -> None:
    service = unit["Service"]
    assert service["User"] not in ("", "root")
    assert service["NoNewPrivileges"] == service["ProtectHome"] == "yes"
    assert service["ProtectSystem"] == "strict"
    assert service["KillSignal"] == "SIGTERM"
    assert int(service["TimeoutStopSec"]) > 15  # the grace of running requests
    assert unit["Install"]["WantedBy"] == "multi-user.target"


@pytest.mark.parametrize(
    ("unit_file", "instance"),
    [
        ("rtask.service", "rtask.service"),
        ("rtask-follower@.service", "rtask-follower@8766.service"),
    ],
)
def test_systemd_itself_finds_no_fault(tmp_path: Path, unit_file: str, instance: str) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("no systemd-analyze here")
    text = (DEPLOY / unit_file).read_text("utf-8")
    copy = tmp_path / instance
    copy.write_text(text.replace("/usr/local/bin/rtask", "/bin/true"), encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(copy)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    faults = [line for line in done.stderr.splitlines() if instance in line]
    assert [line for line in faults if "nknown" in line or "nvalid" in line] == []


@pytest.fixture(scope="module")
def instructions() -> list[tuple[str, str]]:
    """Return each instruction of the Containerfile with its words, lines joined."""
    text = (DEPLOY / "Containerfile").read_text("utf-8")
    lines = "\n".join(line for line in text.splitlines() if not line.startswith("#"))
    joined = re.sub(r"\\\n\s*", " ", lines)
    return [
        (name, rest.strip())
        for name, _, rest in (line.partition(" ") for line in joined.splitlines() if line.strip())
    ]


def test_the_containerfile_has_known_instructions_and_pinned_images(
    instructions: list[tuple[str, str]],
) -> None:
    assert {name for name, _ in instructions} <= INSTRUCTIONS
    images = [rest.split()[0] for name, rest in instructions if name == "FROM"]
    assert images
    assert all(re.fullmatch(r"[\w./-]+:[\w.-]+", image) for image in images)
    assert not any(image.endswith(":latest") for image in images)


def test_the_container_is_nobody_and_copies_all_packages(
    instructions: list[tuple[str, str]],
) -> None:
    users = [rest for name, rest in instructions if name == "USER"]
    assert users
    assert users[-1] not in ("root", "0")
    copied = " ".join(rest for name, rest in instructions if name == "COPY")
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    assert packages <= set(copied.split())
    for name in copied.split():
        assert name.startswith(("/", "-", ".")) or (ROOT / name).exists(), name


def test_the_container_can_recognise(instructions: list[tuple[str, str]]) -> None:
    given = dict(rest.split("=") for name, rest in instructions if name == "ARG")
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras_built = given["EXTRAS"].split(",")
    assert "perception" in extras_built
    assert set(extras_built) <= set(extras["optional-dependencies"])
    assert any(".[${EXTRAS}]" in rest for name, rest in instructions if name == "RUN")


def test_the_container_starts_what_there_is(instructions: list[tuple[str, str]]) -> None:
    found = dict(instructions)
    assert json.loads(found["ENTRYPOINT"]) == ["rtask"]
    command, *words = json.loads(found["CMD"])
    assert command == "serve"
    assert unknown_options(words) == []
    assert "/health/ready" in found["HEALTHCHECK"]
    json.loads(found["HEALTHCHECK"].partition("CMD ")[2])


def test_the_compose_file_starts_what_there_is() -> None:
    yaml = pytest.importorskip("yaml")
    services = yaml.safe_load((DEPLOY / "compose.yaml").read_text("utf-8"))["services"]
    ours = [service for service in services.values() if service["image"] == "rtask"]
    assert len(ours) == 4
    for service in ours:
        name, *words = shlex.split(service["command"])
        assert unknown_options(words, {"serve": serve, "worker": worker}[name]) == []


def test_compose_itself_finds_no_fault(tmp_path: Path) -> None:
    program = shutil.which("docker-compose")
    if program is None:
        pytest.skip("no docker-compose here; apt-get install docker-compose")
    done = subprocess.run(
        [
            program,
            "-f",
            str(DEPLOY / "compose.yaml"),
            "--profile",
            "worker",
            "config",
            "--services",
        ],
        capture_output=True,
        text=True,
        timeout=60,
        env={**os.environ, "HOME": str(tmp_path)},
    )
    assert done.returncode == 0, done.stderr
    services = {"writer", "follower1", "follower2", "worker", "proxy"}
    assert set(done.stdout.split()) == services
