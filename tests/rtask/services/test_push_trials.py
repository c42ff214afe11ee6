"""Push analyses whose shards are calls of a server, and of a worker that is connected to it."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from grasp import pieces
from grasp.push import Elimination, PushTest, Tolerance, analyse, as_part, sample_grasps
from grasp.push.early import analyse_early
from grasp.push.parts import stand_in
from grasp.push.trials import Trials
from rtask.cli import cli
from rtask.client.trials import ServerExecutor
from rtask.errors import CancelledError, ServiceError, UsageError
from rtask.services.builtin.grasping import Grasping
from rtask.services.builtin.push_trials import PushTrials, codes_of, request_of
from rtask.services.call import Call
from rtask.services.host import ServiceHost
from tests.commands import run_command
from tests.servers import RunningServer, running_server


def trials(**settings: float) -> Trials:
    part = as_part(stand_in("A"))
    grasps = sample_grasps(part)
    tolerance = Tolerance(0.045 * part.radius, 0.08 * part.radius, (0.01, 0.1), **settings)
    return Trials.of(part, grasps, PushTest(0.25 * part.diameter), tolerance, 3)


@pytest.mark.parametrize("settings", [{}, {"com_follows": True}, {"correlation": 0.5}])
def test_a_shard_that_went_through_json_gives_the_same_results(settings):
    one = trials(**settings)
    given = json.loads(json.dumps({"shard": request_of(one), "first": 5, "count": 9}))
    with ServiceHost([PushTrials]) as host:
        answer = host.call("rtask/PushTrials", "run", given)
    np.testing.assert_array_equal(codes_of(answer["codes"], len(one.rows)), one(5, 9))


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("test", {"jaw_width": -1.0}, "jaw_width must be positive"),
        ("test", {"jaw": 1.0}, "jaw"),
        ("pose_std", [1.0], "pose_std: expected two numbers, got 1"),
        ("com_std", -1.0, "at least 0"),
        ("com", [1.0], "com: expected two numbers, got 1"),
    ],
)
def test_a_shard_that_cannot_be_run_says_why(field, value, words):
    shard = {**request_of(trials()), field: value}
    with ServiceHost([PushTrials]) as host, pytest.raises(ServiceError, match=words):
        host.call("rtask/PushTrials", "run", {"shard": shard, "first": 0, "count": 1})


@pytest.fixture(scope="module")
def server() -> Iterator[RunningServer]:
    with running_server(None) as running:
        yield running


@pytest.mark.slow
def test_an_analysis_on_a_server_and_its_worker_equals_the_serial_one(server, tmp_path: Path):
    command = [sys.executable, "-m", "rtask", "worker", "rtask.services.builtin.push_trials"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    part = as_part(stand_in("A"))
    grasps = sample_grasps(part)
    test, tolerance = PushTest(0.25 * part.diameter), Tolerance.default(part)
    drop = Elimination((11, 50), 0.5)
    serial = analyse(part, grasps, test, tolerance, elimination=drop, keep_codes=True)
    with (
        subprocess.Popen(
            [*command, "--server", server.url], stdout=subprocess.PIPE, text=True, env=environment
        ) as worker,
        ServerExecutor(server.url, workers=4) as executor,
    ):
        try:
            assert worker.stdout is not None
            assert worker.stdout.readline() == "serving rtask/PushTrials@1.3.0\n"
            shared, sums = (
                analyse(
                    part,
                    grasps,
                    test,
                    tolerance,
                    elimination=drop,
                    keep_codes=keep_codes,
                    executor=executor,
                )
                for keep_codes in (True, False)
            )
            early = analyse_early(
                part, grasps, test, tolerance, samples=16, shards=10, executor=executor
            )
        finally:
            worker.kill()
    np.testing.assert_array_equal(shared.codes, serial.codes)
    for name in ("counts", "order", "quality"):
        np.testing.assert_array_equal(getattr(shared, name), getattr(serial, name))
        np.testing.assert_array_equal(getattr(sums, name), getattr(serial, name))
    every = analyse(part, grasps, test, tolerance, samples=80, keep_codes=True).codes
    taken = np.concatenate([every[:, 8 * k : 8 * k + 8] for k in early.shards], axis=1)
    np.testing.assert_array_equal(early.analysis.codes, taken)


def test_a_shard_whose_answer_does_not_come_is_sent_once_more(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(pieces, "_SLOW_S", 0.01)
    one, sent, end = trials(), [], threading.Event()
    executor = ServerExecutor("http://127.0.0.1:9", workers=2)

    def call(service: str, method: str, given: dict[str, Any]) -> dict[str, Any]:
        sent.append(given["first"])
        if sent.count(0) == 1 and given["first"] == 0:
            end.wait(60)  # as if its worker hung
        codes = host.call(service, method, given)["codes"]
        return {"codes": base64.b64encode(codes).decode()}

    monkeypatch.setattr(executor, "_call", call)
    with ServiceHost([PushTrials]) as host:
        found = dict(executor.finished(one, [(0, 3), (3, 3), (6, 3)]))
        end.set()
    assert sorted(sent) == [0, 0, 3, 6]
    for number, codes in found.items():
        np.testing.assert_array_equal(codes, one(3 * number, 3))


@pytest.mark.slow
def test_the_command_plans_on_a_server_as_it_does_alone(server, tmp_path: Path):
    part = tmp_path / "part.json"
    part.write_text(json.dumps([[0, 0], [0.1, 0], [0.12, 0.05], [0, 0.04]]))
    command = ("grasp", "push", str(part), "--json")
    more = ("--executor", "server", "--server", server.url)
    alone, shared = (
        json.loads(run_command(*command, *options, check=True).stdout) for options in ((), more)
    )
    assert alone["grasps"] == shared["grasps"]
    assert alone["grasps"]


@pytest.mark.slow
def test_what_is_no_trial_of_push_grasps_is_refused(server):
    with ServerExecutor(server.url) as executor, pytest.raises(UsageError, match="not function"):
        list(executor.finished(lambda first, count: first + count, [(0, 1)]))


_ELL = [[0, 0], [0.1, 0], [0.1, 0.04], [0.04, 0.04], [0.04, 0.1], [0, 0.1]]


def test_a_plan_tells_how_far_it_is_and_ends_when_nobody_waits_any_more():
    call, told = Call(), []
    call.on_progress(lambda fraction, text: told.append((fraction, text)))
    found = Grasping({}).plan(np.array(_ELL), call, samples=80)
    assert found.samples == 80
    assert [text for _, text in told] == [f"{10 * k} of 80 perturbed parts" for k in range(1, 9)]
    assert told[-1][0] == 1.0

    early = Grasping({}).plan(np.array(_ELL), Call(), samples=80, deadline=1e-9)
    assert early.samples == 10
    call.on_progress(lambda *_: call.cancel())
    with pytest.raises(CancelledError):
        Grasping({}).plan(np.array(_ELL), call, samples=80)


def test_the_command_ranks_by_what_was_judged_in_time(tmp_path: Path):
    part = tmp_path / "part.json"
    part.write_text(json.dumps(_ELL))
    command = ["grasp", "push", str(part), "--samples", "20000"]
    cut = json.loads(CliRunner().invoke(cli, [*command, "--json", "--deadline", "1e-9"]).stdout)
    assert (cut["samples"], cut["is_cut"]) == (2500, True)
    less = [*command[:-1], "2500"]
    whole = json.loads(CliRunner().invoke(cli, [*less, "--json"]).stdout)
    assert (whole["samples"], whole["is_cut"]) == (2500, False)
    assert cut["grasps"] == whole["grasps"]
    shown = CliRunner().invoke(cli, [*command, "--deadline", "1e-9"])
    assert "2500 perturbed parts" in shown.stdout
    assert "all that were judged in time" in shown.stdout
    refused = CliRunner().invoke(cli, [*command, "--deadline", "0"])
    assert refused.exit_code == 2
    assert "--deadline" in refused.stderr
