"""Workers that connect to a running server: real processes, killed, stopped, and come back."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

import rtask
from rtask.errors import CallFailedError
from tests.commands import CommandProcess, run_command, start_command
from tests.servers import RunningServer, running_server

pytestmark = pytest.mark.slow  # starts a server and workers

FARM = "tests.rtask.services.farm"
LONG_S = 120.0


@contextmanager
def working(url: str, *options: str, token: str = "") -> Iterator[CommandProcess]:
    """Run a worker that is connected; it is killed at the end if it has not ended."""
    environment = {**os.environ, "RTASK_TOKEN": token}
    process = start_command(
        "worker", FARM, "--server", url, *options, environment=environment, stderr=2
    )
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith("serving"):
                break
        else:
            pytest.fail(f"the worker ended with {process.wait()}")
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def wait_for(condition: Callable[[], bool]) -> None:
    """Wait until something is so, for as long as a busy machine may take."""
    until = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        yield running


@pytest.fixture(scope="module")
def client(server: RunningServer) -> Iterator[Any]:
    with rtask.connect(server.url, timeout_s=LONG_S) as connected:
        yield connected


def state(client: Any, name: str) -> str:
    found = [one["state"] for one in client.services() if one["name"] == name]
    return found[0] if found else "unknown"


@pytest.mark.parametrize("form", [(), ("--text",)])
def test_values_travel_to_a_worker_and_back_in_both_forms(server, client, form):
    with working(server.url, *form) as worker:
        field = client.service("farm/Field")
        numbers = np.random.default_rng(1).normal(size=1000)
        pose = np.eye(4)
        pose[:3, 3] = 1.0, 2.0, 3.0
        answer = field.echo(numbers=numbers, data=b"\0\xff\1", pose=pose)
        np.testing.assert_array_equal(answer["numbers"], 2 * numbers)
        assert answer["data"] == "AP8B"
        assert answer["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": 3.0}
        assert answer["pid"] == worker.pid
        described = client.describe_service("farm/Field")
        assert described["methods"]["echo"]["request"]["properties"]["numbers"]["x-unit"] == "m"
        with pytest.raises(CallFailedError, match="numbers: expected a list of numbers"):
            field.echo(numbers="x", data=b"", pose=pose)
        with pytest.raises(CallFailedError, match="ValueError: nothing grows here"):
            field.refuse()
    wait_for(lambda: state(client, "farm/Field") == "waiting")


def test_a_pure_call_whose_worker_is_killed_is_carried_out_by_another(server, client, tmp_path):
    with working(server.url), working(server.url):
        marker = str(tmp_path / "died")
        assert client.service("farm/Field").die_once(marker=marker) > 0
        assert Path(marker).exists()


def test_two_workers_share_the_calls(server, client, tmp_path):
    with working(server.url) as one, working(server.url) as other:
        gate = tmp_path / "gate"
        jobs = [_start(server, "work", {"until": str(gate)}) for _ in range(4)]
        wait_for(lambda: all(_job(server, job)["state"] == "running" for job in jobs))
        gate.touch()
        pids = [_job(server, job, wait=LONG_S)["answer"]["pid"] for job in jobs]
        assert sorted(pids) == sorted([one.pid, one.pid, other.pid, other.pid])


def test_workers_are_started_while_calls_wait_and_end_when_fewer_are_enough(
    server, client, tmp_path
):
    with working(server.url, "--slots", "1", "--up-to", "2", "--idle", "1") as first:
        gate = tmp_path / "gate"
        jobs = [_start(server, "work", {"until": str(gate)}) for _ in range(2)]
        wait_for(lambda: all(_job(server, job)["state"] == "running" for job in jobs))
        described = client.describe_service("farm/Field")
        assert described["calls"] == {"waiting": 0, "running": 2}
        gate.touch()
        pids = {_job(server, job, wait=LONG_S)["answer"]["pid"] for job in jobs}
        assert len(pids) == 2
        assert first.pid in pids
        (other,) = pids - {first.pid}
        wait_for(lambda: not _is_alive(other))
        assert client.service("farm/Field").work() == first.pid


def test_the_workers_that_were_started_end_with_the_first_one(server, client, tmp_path):
    with working(server.url, "--slots", "1", "--up-to", "2") as first:
        gate = tmp_path / "gate"
        jobs = [_start(server, "work", {"until": str(gate)}) for _ in range(2)]
        wait_for(lambda: all(_job(server, job)["state"] == "running" for job in jobs))
        gate.touch()
        pids = {_job(server, job, wait=LONG_S)["answer"]["pid"] for job in jobs}
        first.kill()  # and cannot end the other one itself
        wait_for(lambda: not any(map(_is_alive, pids - {first.pid})))


def _is_alive(pid: int) -> bool:
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    except OSError:
        return False


def test_a_job_shows_progress_and_is_cancelled_in_the_worker(server, client, tmp_path):
    with working(server.url):
        job = _start(server, "work", {"until": str(tmp_path / "never")})
        wait_for(lambda: _job(server, job)["message"] == "waiting")
        httpx.delete(server.url + job)
        assert _job(server, job)["state"] == "cancelled"
        assert client.service("farm/Field").work() > 0


def test_a_writing_call_whose_worker_dies_is_an_error_and_the_head_is_unchanged(
    server, client, tmp_path
):
    name = f"farm/Store{'x' * len(tmp_path.name)}"
    httpx.put(f"{server.url}/datasets/{name}", json={}).raise_for_status()
    with working(server.url, "--cache", str(tmp_path / "cache")) as worker:
        barn = client.service("farm/Barn", data={"store": name})
        assert barn.add(number=5) == 5
        assert barn.add(number=2) == 7
        before = httpx.get(f"{server.url}/datasets/{name}@head").json()["digest"]
        with pytest.raises(CallFailedError, match="left before it answered") as refused:
            barn.add(number=1, marker=str(tmp_path / "marker"))
        assert refused.value.details["http_status"] == 502
        assert worker.wait(LONG_S) == -signal.SIGKILL
    assert httpx.get(f"{server.url}/datasets/{name}@head").json()["digest"] == before
    assert httpx.get(f"{server.url}/datasets/{name}/files/sum").content == b"7"


def test_a_worker_that_is_told_to_stop_ends_its_calls_first(server, client, tmp_path):
    with working(server.url) as worker:
        gate = tmp_path / "gate"
        job = _start(server, "work", {"until": str(gate)})
        wait_for(lambda: _job(server, job)["state"] == "running")
        worker.send_signal(signal.SIGTERM)
        wait_for(lambda: state(client, "farm/Field") == "waiting")
        gate.touch()
        assert _job(server, job, wait=LONG_S)["answer"]["pid"] == worker.pid
        assert worker.wait(LONG_S) == 0


def test_without_a_worker_the_caller_learns_when_to_come_back(server, client):
    with working(server.url):
        pass
    wait_for(lambda: state(client, "farm/Field") == "waiting")
    answer = httpx.post(f"{server.url}/services/farm/Field/work", json={}, timeout=LONG_S)
    assert answer.status_code == 503
    assert "no worker that offers it is connected" in answer.json()["detail"]
    assert int(answer.headers["Retry-After"]) >= 1
    with working(server.url):
        assert client.service("farm/Field").work() > 0


def test_a_worker_comes_back_after_the_server_was_restarted(tmp_path):
    with running_server(tmp_path / "data") as first, working(first.url) as worker:
        first.stop()
        command = (sys.executable, "-m", "rtask")
        with (
            running_server(tmp_path / "data", "-p", str(first.port), command=command) as second,
            rtask.connect(second.url, timeout_s=LONG_S) as again,
        ):
            wait_for(lambda: state(again, "farm/Field") == "ready")
            assert again.service("farm/Field").work() == worker.pid


def test_offering_services_takes_a_right_of_its_own(tmp_path):
    data = tmp_path / "data"
    made = ("token", "create", "-d", str(data), "--robot")
    plain, allowed = (
        run_command(*made, *more, check=True).stdout.strip()
        for more in (["nao-1"], ["farm", "--right", "deploy"])
    )
    with running_server(data) as server:
        command = ("worker", FARM, "--server", server.url)
        for token, words in ((plain, "needs the right deploy"), ("rt_wrong", "valid token")):
            refused = run_command(*command, environment={**os.environ, "RTASK_TOKEN": token})
            assert refused.returncode != 0
            assert words in refused.stderr
            assert "Traceback" not in refused.stderr
        with (
            working(server.url, token=allowed) as worker,
            rtask.connect(server.url, token=plain, timeout_s=LONG_S) as robot,
        ):
            assert robot.service("farm/Field").work() == worker.pid


@pytest.mark.skipif(shutil.which("node") is None, reason="needs node")
def test_a_worker_may_be_written_in_another_language(server, client):
    script = Path(__file__).with_name("worker.mjs")
    address = server.websocket + "rosbridge"
    command = ["node", "--experimental-websocket", "--no-warnings", str(script), address]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "serving farm/Script@1.0.0\n"
            farm = client.service("farm/Script")
            np.testing.assert_array_equal(farm.multiply(numbers=[1, 2.5]), [2.0, 5.0])
            np.testing.assert_array_equal(farm.multiply(numbers=[1], factor=3), [3.0])
            with pytest.raises(CallFailedError, match="nothing to multiply by"):
                farm.multiply(numbers=[1], factor=0)
            with pytest.raises(CallFailedError, match="factor: expected a finite number"):
                farm.multiply(numbers=[1], factor="many")
        finally:
            process.kill()


def _start(server: RunningServer, method: str, args: dict[str, Any]) -> str:
    address = f"{server.url}/services/farm/Field/{method}"
    answer = httpx.post(address, json=args, headers={"Prefer": "respond-async"})
    answer.raise_for_status()
    return str(answer.headers["Location"])


def _job(server: RunningServer, job: str, wait: float = 0.0) -> Any:
    until = time.monotonic() + wait
    while True:
        found = httpx.get(server.url + job, params={"wait": min(wait, 10)}, timeout=LONG_S).json()
        if found["state"] not in ("queued", "running") or time.monotonic() >= until:
            return found
