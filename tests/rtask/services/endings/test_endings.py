"""Whatever ends a call, and whenever: what was stored is what its caller was told.

Each case stops a call at a named moment, ends it from outside there, lets it go on, and compares
the answer, the state of the job, its events and the dataset.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rtask.errors import CancelledError, DeadlineError, RtaskError, WorkerDiedError
from rtask.services import ServiceHost
from rtask.services.call import Call, Invocation
from rtask.services.datasets.store import Datasets
from rtask.services.definition import define
from rtask.services.description import described
from rtask.services.jobs import ENDED, Job
from rtask.services.task import Task
from tests.rtask.services.endings.moments import FarLink, FarTally, Gate, ProcessTally, Tally

STORE = "lab/Sum"
IN_WORKER = ("in the method", "after it wrote")
BEFORE_STORING = ("given to a worker", *IN_WORKER, "returned")
FROM_STORING_ON = ("being stored", "stored")
MOMENTS = ("waiting", *BEFORE_STORING, *FROM_STORING_ON, "answered")
THREADS, OUTWARD, PROCESSES = "moments/Tally", "moments/FarTally", "moments/ProcessTally"


def opened(folder: Path | None = None) -> ServiceHost:
    host = ServiceHost([Tally, ProcessTally], datasets=Datasets(folder), check_every=1)
    far = define(FarTally)
    host.outward.join(FarLink(host), described(far, [far.version], "ready"), 1)
    host.datasets.create(STORE)
    host.datasets.put(STORE, {"sum": b"1"})
    return host


@pytest.fixture(scope="module")
def host() -> Iterator[ServiceHost]:
    with opened() as made:
        yield made


def total(datasets: Datasets) -> int:
    return int(datasets.read(f"{STORE}@head", "sum"))


def prepared(host: ServiceHost, service: str, tmp_path: Path, parent: Call | None = None) -> Task:
    args = {"number": 10, "gate": str(tmp_path)}
    return host.prepare(Invocation(service, "add", args, None, {"store": STORE}, 60.0, parent))


def let_its_time_pass(task: Task, parent: Call) -> None:
    task.call.deadline = time.monotonic()
    task.expire()


ENDS: dict[str, tuple[Callable[[Task, Call], object], type[RtaskError], str]] = {
    "cancel": (lambda task, parent: task.cancel(), CancelledError, "cancelled"),
    "deadline": (let_its_time_pass, DeadlineError, "timed_out"),
    "caller gone": (lambda task, parent: parent.cancel(), CancelledError, "cancelled"),
}
"""How a call is ended, and the error and the state of its job that follow."""


def outcome(task: Task) -> str:
    error = task.done.exception(timeout=60.0)
    return "answered" if error is None else type(error).__name__


def check(host: ServiceHost, service: str, cause: str, moment: str, tmp_path: Path, gate: Gate):
    """End a call at a moment, and compare everything that tells of its end."""
    end, error, state = ENDS[cause]
    before, dropped = total(host.datasets), host.dropped
    parent = Call(timeout_s=60.0)
    task = prepared(host, service, tmp_path, parent)
    first = None
    if moment == "waiting":  # the only worker of a service that writes is busy
        gate.stop_at("in the method")
        first = host.submit(
            Invocation(service, "add", {"number": 0, "gate": str(tmp_path)}, None, {"store": STORE})
        )
        gate.wait()
    else:
        gate.stop_at(moment)
    job = host.start_job(task, "me")
    if moment not in ("waiting", "answered"):
        gate.wait()
    if moment == "answered":
        task.result()
    end(task, parent)
    told_at_once = job.state
    gate.open()
    if first is not None:
        first.result()
    host.call(service, "add", {"number": 0}, data={"store": STORE}, timeout_s=60.0)  # the next one
    is_stored = moment in (*FROM_STORING_ON, "answered")
    assert outcome(task) == ("answered" if is_stored else error.__name__)
    assert job.state == ("succeeded" if is_stored else state)
    assert told_at_once in ((job.state, "running") if is_stored else (job.state,))
    assert total(host.datasets) == before + (10 if is_stored else 0)
    assert [facts["state"] for _, facts in job.events(0) if facts["state"] in ENDED] == [job.state]
    was_carried_out = moment in BEFORE_STORING
    assert host.dropped - dropped == (1 if was_carried_out else 0)


@pytest.mark.parametrize("moment", MOMENTS)
@pytest.mark.parametrize("cause", ENDS)
@pytest.mark.parametrize("service", [THREADS, OUTWARD])
def test_what_is_stored_is_what_the_caller_was_told(host, gate, tmp_path, service, cause, moment):
    check(host, service, cause, moment, tmp_path, gate)


@pytest.mark.slow  # starts a process
@pytest.mark.parametrize(
    "moment",
    [
        "waiting",
        "stored",
        pytest.param("after it wrote", marks=pytest.mark.deep),
        pytest.param("returned", marks=pytest.mark.deep),
    ],
)
@pytest.mark.parametrize("cause", ENDS)
def test_the_same_holds_in_processes(host, gate, tmp_path, cause, moment):
    check(host, PROCESSES, cause, moment, tmp_path, gate)


@pytest.mark.parametrize("moment", [*IN_WORKER, "returned", *FROM_STORING_ON])
def test_a_connected_worker_that_goes_has_written_only_if_its_answer_had_come(
    gate, tmp_path, moment
):
    with opened() as host:
        (link,) = host.outward._heard
        assert isinstance(link, FarLink)
        gate.stop_at(moment)
        task = prepared(host, OUTWARD, tmp_path)
        job = host.start_job(task, "me")
        gate.wait()
        host.outward.leave(link)
        gate.open()
        had_come = moment not in IN_WORKER
        assert outcome(task) == ("answered" if had_come else WorkerDiedError.__name__)
        assert job.state == ("succeeded" if had_come else "failed")
        for thread in link.threads:
            thread.join()
        assert total(host.datasets) == (11 if had_come else 1)


@pytest.mark.parametrize("service", [THREADS, OUTWARD])
@pytest.mark.parametrize("moment", MOMENTS[1:-1])
def test_a_server_that_is_killed_has_stored_all_or_nothing(gate, tmp_path, service, moment):
    folder = tmp_path / "datasets"
    gate.stop_at(moment)
    child = os.fork()
    if not child:
        host = opened(folder)
        host.start(prepared(host, service, tmp_path))
        time.sleep(60.0)
        os._exit(1)
    try:
        gate.wait()
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert total(Datasets(folder)) == (11 if moment == "stored" else 1)


def test_a_call_that_has_ended_writes_nothing_to_the_graph_any_more():
    call = Call()
    with call.ending.writing() as commits:
        commits.append(7)
    call.cancel()
    with pytest.raises(CancelledError), call.ending.writing():
        pytest.fail("it was allowed to write")
    error = call.ending.done.exception()
    assert "before that it had written to the graph (commit 7)" in str(error)
    assert error.details["commits"] == [7]


def test_what_is_committed_last_is_answered_even_if_its_time_passes_meanwhile():
    call = Call(timeout_s=60.0)
    with call.ending.writing(is_last=True):
        assert not call.cancel()
        assert not call.expire()
    assert call.ending.succeed("stored")
    assert call.ending.done.result() == "stored"


def test_a_write_that_is_refused_ends_as_what_was_asked_of_it_meanwhile():
    call = Call()

    def write() -> None:
        with call.ending.writing(is_last=True):
            call.cancel()
            raise ValueError("refused")

    with pytest.raises(ValueError, match="refused"):
        write()
    assert isinstance(call.ending.done.exception(), CancelledError)


def test_a_call_that_nobody_waits_for_ends_at_its_deadline_all_the_same(host, tmp_path):
    task = prepared(host, THREADS, tmp_path)
    job = Job(task, "me")
    task.call.deadline = time.monotonic()
    assert (job.state, type(job.error)) == ("timed_out", DeadlineError)
    assert not task.succeed(None)
