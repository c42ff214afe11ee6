"""Queues, deadlines, jobs, and what happens at the end of a host."""

from __future__ import annotations

import threading

import pytest

from rtask.errors import (
    CancelledError,
    DeadlineError,
    QueueFullError,
    StartupFailedError,
    StateChangedError,
    UnknownTermError,
    UnusableServiceError,
)
from rtask.services import (
    Service,
    ServiceHost,
    data_resource,
    jobs,
    method,
    shutdown,
    startup,
)
from rtask.services.call import Call, Invocation
from rtask.services.host import MAX_POOLS
from rtask.services.pool import Pool, Sizes
from rtask.services.task import Task
from tests.rtask.services.lab import (
    CLOSED,
    Arm,
)


def test_a_service_that_cannot_start_says_so_and_pauses(host):
    for _ in range(2):
        with pytest.raises(StartupFailedError, match="OSError: no such device"):
            host.call("lab/Broken", "use")
    assert host.state(host.registry.find("lab/Broken")) == "failed"
    assert host.problem(host.registry.find("lab/Broken")).is_transient, "it may be plugged in"


class Unusable(Service):
    """A service whose model is missing."""

    name = "lab/Unusable"
    starts = 0

    @startup
    def load(self) -> None:
        Unusable.starts += 1
        raise FileNotFoundError("model.urdf")

    @method
    def use(self) -> None:
        """Be of no use."""


def test_a_service_that_will_never_start_says_so_and_is_not_tried_again():
    with ServiceHost([Unusable, Arm]) as host:
        assert {one["state"] for one in host.listing()} == {"untried"}
        (problem,) = host.check()
        assert "FileNotFoundError: model.urdf" in str(problem)
        arm, unusable = host.listing()
        assert (arm["state"], unusable["state"]) == ("ready", "failed")
        assert unusable["problem"]["transient"] is False
        with pytest.raises(UnusableServiceError) as caught:
            host.call("lab/Unusable", "use")
        assert (caught.value.status, caught.value.is_transient) == (500, False)
        assert "retry_after_s" not in caught.value.details
        assert Unusable.starts == 1


def test_callers_hear_of_a_start_that_has_failed_ever_so_often():
    def start():
        raise UnknownTermError("no such device")  # of the product's own errors, nothing is logged

    pool = Pool("lab/Broken", start, Sizes(1))
    for _ in range(1_030):  # two to the power of this is more than a float holds
        pool._try_again_s = 0.0
        task = Task(None, None, Call(), "lab/Broken@1.0.0")
        pool.submit(task)
        assert isinstance(task.done.exception(timeout=60.0), StartupFailedError)


@pytest.mark.slow
def test_queues_without_work_go_when_there_are_many(host):
    host.datasets.create("robots/Toy")
    for number in range(MAX_POOLS + 8):
        host.datasets.put("robots/Toy", {"model": str(number).encode()})
        proxy = host.connect("lab/Reader", {"model": "robots/Toy@head"})
        assert proxy.read() == str(number)
    alive = [one for one in threading.enumerate() if one.name == "lab/Reader@0.1.0"]
    assert len(alive) <= MAX_POOLS


def test_a_call_ends_at_its_deadline_and_the_method_is_asked_to_stop(host):
    with pytest.raises(DeadlineError, match=r"no answer within 0.05 s"):
        host.call("lab/Arm", "count", {"steps": 1000, "pause_s": 0.01}, timeout_s=0.05)


class Gate(Service):
    """Work that ends when it is told to."""

    name, max_workers, max_waiting = "lab/Gate", 1, 2
    opened = threading.Event()
    entered = threading.Event()

    @method
    def go_through(self, number: int) -> int:
        """Wait for the gate."""
        self.entered.set()
        self.opened.wait(60)
        return number


def test_a_full_queue_refuses_and_loses_nothing():
    Gate.opened.clear()
    Gate.entered.clear()
    with ServiceHost([Gate]) as host:
        first = host.submit(Invocation("lab/Gate", "go_through", {"number": 0}))
        assert Gate.entered.wait(60)
        waiting = [host.submit(Invocation("lab/Gate", "go_through", {"number": k})) for k in (1, 2)]
        with pytest.raises(QueueFullError) as caught:
            host.submit(Invocation("lab/Gate", "go_through", {"number": 3}))
        assert caught.value.details["retry_after_s"] == 1
        waiting[0].cancel()
        Gate.opened.set()
        assert [first.result()["result"], waiting[1].result()["result"]] == [0, 2]
        with pytest.raises(CancelledError):
            waiting[0].result()


def test_a_job_tells_its_progress_and_can_be_cancelled(host):
    task = host.prepare(Invocation("lab/Arm", "count", {"steps": 500, "pause_s": 0.01}))
    job = host.start_job(task, "me")
    seen = job.wait(30, after=0)
    assert job.state == "running"
    (_, event), *_ = job.events(0)
    assert event["message"] == "step 0"
    assert host.jobs.find(job.id, "me") is job
    with pytest.raises(UnknownTermError):
        host.jobs.find(job.id, "another")
    job.cancel()
    assert job.state == "cancelled"
    assert job.wait(30, after=seen) > seen
    assert job.facts()["state"] == "cancelled"


def test_a_job_keeps_its_answer(host):
    job = host.start_job(host.prepare(Invocation("lab/Arm", "stretch", {"joints": [1]})), "me")
    job.wait(60)
    assert job.answer() == {"distance": 1.0, "joints": [1.0]}
    assert job.facts()["progress"] == 1.0


def test_the_oldest_answers_go_when_all_together_are_too_large(host, monkeypatch):
    monkeypatch.setattr(jobs, "MAX_ANSWER_BYTES", 4_000)

    def run() -> jobs.Job:
        long = Invocation("lab/Arm", "stretch", {"joints": [1] * 200})
        job = host.start_job(host.prepare(long), "me")
        while not job.answer_bytes:  # an answer is measured after its caller has been woken
            job.wait(30, after=job.wait(0, after=None))
        return job

    first, second, third = run(), run(), run()
    last = run()  # what is too much goes when a new job comes
    with pytest.raises(UnknownTermError, match="until later answers need the room"):
        host.jobs.find(first.id, "me")
    assert [one.id for one in host.jobs.of("me")] == [last.id, third.id, second.id]
    assert second.answer()["joints"] == [1.0] * 200


def test_calls_from_many_threads_are_all_answered():
    with ServiceHost([Arm]) as host:
        tasks = [
            host.submit(Invocation("lab/Arm", "forward", {"joints": [0], "scale": k % 7}))
            for k in range(90)
        ]
        assert [task.result()["pose"][0, 3] for task in tasks] == [k % 7 for k in range(90)]


def test_closing_asks_what_runs_to_stop():
    with ServiceHost([Arm]) as host:
        task = host.submit(Invocation("lab/Arm", "count", {"steps": 10_000, "pause_s": 0.01}))
        host.jobs.add(task, "me").wait(30, after=0)
    with pytest.raises(CancelledError):
        task.result()


def test_shut_down_runs_the_methods_marked_for_it():
    CLOSED.clear()
    with ServiceHost([Arm]) as host:
        host.call("lab/Arm", "stretch", {"joints": []})
    assert CLOSED == ["lab/Arm"]


class Stubborn(Service):
    """A service whose shut-down fails."""

    name, max_workers = "lab/Stubborn", 1

    @shutdown
    def leave(self) -> None:
        raise OSError("still busy")

    @method
    def remember(self, key: str) -> str:
        """Break the rule, so that the instance is replaced."""
        self.key = key
        return key


def test_a_shut_down_that_fails_keeps_no_worker_from_being_replaced():
    with ServiceHost([Stubborn], check_every=1) as host:
        for key in "ab":
            with pytest.raises(StateChangedError):
                host.call("lab/Stubborn", "remember", {"key": key}, timeout_s=20)


class Slow(Service):
    """A service that takes its time to shut down."""

    name = "lab/Slow"
    model = data_resource("binary")
    may_end = threading.Event()

    @shutdown
    def leave(self) -> None:
        self.may_end.wait(60)
        CLOSED.append(self.name)

    @method
    def use(self) -> None:
        """Be of use."""


def test_calls_do_not_wait_for_queues_that_are_shut_down(monkeypatch):
    monkeypatch.setattr("rtask.services.host.MAX_POOLS", 1)
    Slow.may_end.clear()
    CLOSED.clear()
    with ServiceHost([Slow]) as host:
        for name in ("lab/A", "lab/B"):
            host.datasets.create(name)
            host.call("lab/Slow", "use", data={"model": name})
        assert not CLOSED, "the second call was answered before the first queue had ended"
        Slow.may_end.set()
    assert CLOSED == ["lab/Slow", "lab/Slow"], "closing the host waits for both"
