"""Services in process: declaration, versions, calls, the rule about state, queues and jobs."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

import rtask
from rtask.errors import (
    CancelledError,
    DeadlineError,
    ForbiddenError,
    MissingDataError,
    QueueFullError,
    ServiceError,
    ServiceFailedError,
    StartupFailedError,
    StateChangedError,
    UnknownTermError,
    UsageError,
)
from rtask.kb.commit.access import Access
from rtask.services import (
    Call,
    Service,
    ServiceHost,
    brass,
    data_resource,
    method,
    shutdown,
    startup,
)
from rtask.services.call import Invocation
from rtask.services.definition import define
from rtask.services.host import MAX_POOLS
from rtask.services.registry import GROUP, installed, load
from tests.rtask.services.lab import (
    CLOSED,
    Arm,
    Broken,
    Counter,
    Detour,
    Notebook,
    OldArm,
    Reader,
)


@pytest.fixture
def host() -> Iterator[ServiceHost]:
    with ServiceHost([OldArm, Arm, Detour, Broken, Reader], check_every=1) as opened:
        yield opened


def test_a_call_is_checked_carried_out_and_answered_as_declared(host):
    answer = host.call("lab/Arm", "forward", {"joints": [0.0, "0.0"], "scale": 2})
    assert answer.as_json()["pose"]["position"] == {"x": 4.0, "y": 0.0, "z": 0.0}
    assert answer["pose"][0, 3] == 4.0


def test_a_proxy_has_the_signatures_and_returns_single_values_as_they_are(host):
    arm = host.connect("lab/Arm@1.*")
    assert arm.service == "lab/Arm@1.2.0"
    assert arm.forward([0.0])[:3, 3].tolist() == [1.0, 0.0, 0.0]
    assert arm.forward(joints=[0.0], scale=3)[0, 3] == 3.0
    assert arm.forward.__doc__.startswith("Pose of the hand")
    assert arm.stretch([1, 2]).joints.tolist() == [1.0, 2.0]
    with pytest.raises(UnknownTermError, match="did you mean 'forward'"):
        arm.foward([0])
    with pytest.raises(TypeError, match="joints"):
        arm.forward()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ({}, "joints is missing: Angles from the base to the hand"),
        ({"joints": "x"}, "joints: expected a list of numbers"),
        ({"joints": [1], "scale": 11}, "scale: 11 is above 10"),
        ({"joints": [1], "scal": 1}, "unknown field 'scal'; did you mean 'scale'"),
    ],
)
def test_a_wrong_request_is_refused_at_its_path(host, args, words):
    with pytest.raises(UsageError, match=words):
        host.call("lab/Arm", "forward", args)


@pytest.mark.parametrize(
    ("wanted", "version"),
    [("", "1.2.0"), ("@1.*", "1.2.0"), ("@1.1.*", "1.1.9"), ("@1.1.9", "1.1.9")],
)
def test_a_version_is_exact_or_the_newest_that_fits(host, wanted, version):
    assert host.registry.find(f"lab/Arm{wanted}").version == version


def test_a_version_that_is_not_there_names_those_that_are(host):
    with pytest.raises(UnknownTermError, match=r"no version 2.\*; there are 1.2.0, 1.1"):
        host.call("lab/Arm@2.*", "forward")
    with pytest.raises(UsageError, match=r"expected 1.2.3"):
        host.call("lab/Arm@newest", "forward")
    with pytest.raises(UsageError, match=r"expected 1.2.3"):
        host.call(f"lab/Arm@{'9' * 5000}", "forward")


def test_a_version_that_is_taken_is_refused():
    class Other(Service):
        """Another arm."""

        name, version = "lab/Arm", "1.2.0"

        @method
        def forward(self) -> None:
            """Nothing."""

    with pytest.raises(UsageError, match=r"lab/Arm@1.2.0 is there already"):
        ServiceHost([Arm, Other])


def test_what_a_call_changes_in_the_state_is_found_and_named(host):
    with pytest.raises(StateChangedError, match="teach changed cache") as caught:
        host.call("lab/Arm", "teach", {"key": "a"})
    assert caught.value.details["attributes"] == ["cache"]
    # The changed instance is gone: the next call meets a fresh one.
    assert host.call("lab/Arm", "forward", {"joints": []}).as_json()


def test_the_errors_of_a_service_reach_the_caller_without_a_traceback(host):
    with pytest.raises(ServiceError, match="out of reach") as refused:
        host.call("lab/Arm", "fail", {"kind": "refuse"})
    assert (refused.value.status, refused.value.details) == (422, {"reach": 3.0})
    with pytest.raises(ServiceFailedError, match="ZeroDivisionError: division by zero") as crashed:
        host.call("lab/Arm", "fail", {"kind": "crash"})
    assert "line" not in str(crashed.value)
    with pytest.raises(ServiceFailedError, match="returned what it does not declare: result"):
        host.call("lab/Arm", "fail", {"kind": "wrong"})


def test_a_service_that_cannot_start_says_so_and_pauses(host):
    for _ in range(2):
        with pytest.raises(StartupFailedError, match="OSError: no such device"):
            host.call("lab/Broken", "use")
    assert host.state(host.registry.find("lab/Broken")) == "failed"


def test_a_reader_may_not_call_what_writes(host):
    with pytest.raises(ForbiddenError, match="needs scope write"):
        host.call("lab/Arm", "store", {"text": "x"}, Access(None, "reader"))


def test_data_resources_are_bound_by_name_at_a_version(host):
    datasets = host.datasets
    datasets.create("robots/Toy")
    datasets.put("robots/Toy", {"model": b"an arm"})
    datasets.snapshot("robots/Toy")
    proxy = host.connect("lab/Reader", {"model": "robots/Toy"})
    assert proxy.read() == "an arm"
    datasets.put("robots/Toy", {"model": b"a longer arm"})
    assert proxy.read() == "an arm"
    assert host.connect("lab/Reader", {"model": "robots/Toy@head"}).read() == "a longer arm"
    datasets.put("robots/Toy", {"model": b"the longest arm"})
    assert host.connect("lab/Reader", {"model": "robots/Toy@head"}).read() == "the longest arm"
    with pytest.raises(MissingDataError, match="needs a dataset for 'model'"):
        host.call("lab/Reader", "read")
    with pytest.raises(MissingDataError, match="no dataset robots/Tox; did you mean"):
        host.call("lab/Reader", "read", data={"model": "robots/Tox"})
    with pytest.raises(UsageError, match="expected names of datasets"):
        host.call("lab/Reader", "read", data={"model": 3})
    with pytest.raises(UsageError, match="no data resource 'modl'; did you mean 'model'"):
        host.call("lab/Reader", "read", data={"modl": "robots/Toy"})


@pytest.mark.slow
def test_queues_without_work_go_when_there_are_many(host):
    host.datasets.create("robots/Toy")
    for number in range(MAX_POOLS + 8):
        host.datasets.put("robots/Toy", {"model": str(number).encode()})
        proxy = host.connect("lab/Reader", {"model": "robots/Toy@head"})
        assert proxy.read() == str(number)
    alive = [one for one in threading.enumerate() if one.name == "lab/Reader@0.1.0"]
    assert len(alive) <= MAX_POOLS


def test_a_service_asks_the_graph_and_may_not_write_what_it_only_reads():
    with rtask.open(":memory:", plain=True) as kb, ServiceHost([Counter], kb) as host:
        kb.update("INSERT DATA { <urn:a> <urn:b> <urn:c>, <urn:d> }")
        assert host.call("lab/Counter", "count")["count"] == 2


def test_a_nested_call_keeps_its_deadline_and_a_circle_is_refused(host):
    assert host.call("lab/Detour", "reach", {"joints": [1, 2]})["result"] == 2.0
    with pytest.raises(UsageError, match="a circle of calls: lab/Arm -> lab/Detour -> lab/Arm"):
        host.call("lab/Arm", "ask_again", {"depth": 1})


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
        self.opened.wait(30)
        return number


def test_a_full_queue_refuses_and_loses_nothing():
    Gate.opened.clear()
    Gate.entered.clear()
    with ServiceHost([Gate]) as host:
        first = host.submit(Invocation("lab/Gate", "go_through", {"number": 0}))
        assert Gate.entered.wait(30)
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
    job.wait(30)
    assert job.answer() == {"distance": 1.0, "joints": [1.0]}
    assert job.facts()["progress"] == 1.0


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


class NoAnnotation(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, speed) -> None:
        """Go."""


class Unsendable(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, lock: threading.Event) -> None:
        """Go."""


class NoResult(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, call: Call):
        """Go."""


class BadName(Service):
    """A mistake."""

    name = "Wrong"

    @method
    def go(self) -> None:
        """Go."""


class Idle(Service):
    """A mistake."""

    name = "lab/Wrong"


class TwoKinds(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, speed: int | str) -> None:
        """Go."""


class TakenName(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, copy: int) -> None:
        """Go."""


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (NoAnnotation, r"test_services.py:\d+: NoAnnotation.go: parameter 'speed' has no annot"),
        (Unsendable, r"Unsendable.go: lock: .*Event.* cannot be sent"),
        (TwoKinds, r"TwoKinds.go: speed: int \| str cannot be sent"),
        (NoResult, "NoResult.go: the result has no annotation"),
        (BadName, "expected <namespace>/<name>"),
        (Idle, "Idle has no method"),
        (TakenName, "a parameter cannot be called 'copy'"),
    ],
)
def test_a_mistake_in_a_declaration_names_file_line_and_parameter(wrong, words):
    with pytest.raises(UsageError, match=words):
        define(wrong)


def test_a_data_resource_is_of_a_known_type():
    with pytest.raises(UsageError, match="unknown type 'sql'"):
        data_resource("sql")  # type: ignore[arg-type]  # the mistake


def test_services_are_loaded_from_a_file_and_from_a_module(tmp_path: Path):
    assert {one.name for one in load("tests.rtask.services.lab")} >= {"lab/Arm", "lab/Reader"}
    file = tmp_path / "mine.py"
    file.write_text(
        "from rtask.services import Service, method\n"
        "class Half(Service):\n"
        "    '''Halves.'''\n"
        "    name = 'lab/Half'\n"
        "    @method\n"
        "    def of(self, number: float) -> float:\n"
        "        '''Half of a number.'''\n"
        "        return number / 2\n",
        "utf-8",
    )
    with ServiceHost(load(str(file))) as host:
        assert host.call("lab/Half", "of", {"number": 3}).as_json() == {"result": 1.5}
    with pytest.raises(UsageError, match="no file"):
        load(str(tmp_path / "none.py"))
    with pytest.raises(UsageError, match="defines no service"):
        load("tests.rtask.services")
    with pytest.raises(UsageError, match="no module no_such"):
        load("no_such")


def test_arrays_and_bytes_are_json_in_answers():
    with ServiceHost([Arm]) as host:
        answer = host.call("lab/Arm", "weigh", {"image": "AAEC"})
        assert answer.to_json() == b'{"size":3}'
        stretched = host.call("lab/Arm", "stretch", {"joints": np.array([0.5])})
        assert stretched.to_json() == b'{"distance":1.0,"joints":[0.5]}'


class Quitter(Service):
    """A service whose author takes it for a program."""

    name, max_workers = "lab/Quitter", 1

    @method
    def leave(self) -> None:
        """Leave."""
        sys.exit("usage: leave")


class Unready(Quitter):
    """One that leaves before it is ready."""

    name = "lab/Unready"

    @startup
    def load(self) -> None:
        sys.exit(2)


def test_a_method_that_exits_is_an_error_of_its_call():
    with ServiceHost([Quitter, Unready]) as host:
        for _ in range(2):
            with pytest.raises(ServiceFailedError, match="SystemExit: usage: leave"):
                host.call("lab/Quitter", "leave", timeout_s=20)
        with pytest.raises(StartupFailedError, match="SystemExit: 2"):
            host.call("lab/Unready", "leave", timeout_s=20)


class Silent(Service):
    """A service that answers nothing."""

    name = "lab/Silent"

    @method
    def use(self) -> None:
        """Be of use."""


class Slow(Service):
    """A service that takes its time to shut down."""

    name = "lab/Slow"
    model = data_resource("binary")
    may_end = threading.Event()

    @shutdown
    def leave(self) -> None:
        self.may_end.wait(20)
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


def test_a_package_whose_services_cannot_be_loaded_is_left_out(monkeypatch, tmp_path, caplog):
    (tmp_path / "broken_services.py").write_text("undefined_name\n")
    monkeypatch.syspath_prepend(tmp_path)
    entries = [EntryPoint(n, n, GROUP) for n in ("broken_services", "tests.rtask.services.lab")]
    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: entries)
    assert [one.__name__ for one in installed()] == ["tests.rtask.services.lab"]
    assert "services of broken_services cannot be loaded" in caplog.text


def test_a_method_without_a_result_is_answered_by_nothing():
    with ServiceHost([Silent]) as host:
        assert host.call("lab/Silent", "use").as_json() == {}
        assert host.connect("lab/Silent").use().as_json() == {}


def test_a_method_that_may_call_others_is_not_said_to_only_read(host):
    methods = host.description("lab/Arm")["methods"]
    only_reads = {name: one["only_reads"] for name, one in methods.items()}
    assert only_reads["forward"]
    assert not only_reads["store"]
    assert not only_reads["ask_again"], "it may call what writes"


def test_a_service_that_writes_sees_what_others_wrote_to_its_data_between_two_calls():
    with ServiceHost([Notebook]) as host:
        host.datasets.create("lab/Sums")
        add = host.connect("lab/Notebook", {"store": "lab/Sums"}).add
        assert (add(1), add(2)) == (1, 3)
        host.datasets.put("lab/Sums", {"sum": b"100"})
        assert add(1) == 101
        assert host.datasets.read("lab/Sums@head", "sum") == b"101"


def test_a_writable_resource_of_brass_is_written_to():
    @brass.data_resource("store", writable=True)
    class Store(brass.Service):
        """A shelf."""

        name = "lab/Store"

        @brass.input(brass.String, "text")
        @brass.output(brass.String, "path")
        def put(self, text: str) -> str:
            self.store.write("/text", text.encode())
            return str(self.store.get_file_path_for("/before"))

    with ServiceHost([Store]) as host:
        host.datasets.create("lab/Shelf")
        host.datasets.put("lab/Shelf", {"before": b"1"})
        put = host.connect("lab/Store", {"store": "lab/Shelf"}).put
        assert Path(put("cup")).read_bytes() == b"1"
        assert host.datasets.read("lab/Shelf@head", "text") == b"cup"
