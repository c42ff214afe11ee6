"""Services in process: declaration, versions, calls, the rule about state, queues and jobs."""

from __future__ import annotations

import asyncio
import inspect
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from click.testing import CliRunner

import rtask
from rtask.cli import cli
from rtask.errors import (
    ForbiddenError,
    MissingDataError,
    ServiceError,
    ServiceFailedError,
    StartupFailedError,
    StateChangedError,
    UnknownTermError,
    UsageError,
)
from rtask.kb.commit.access import Access
from rtask.services import (
    Service,
    ServiceHost,
    brass,
    method,
    startup,
)
from rtask.services.proxy import offer_read
from rtask.wire.message import Message
from rtask.wire.ros import ros_types
from rtask.wire.types import Unit
from tests.rtask.services.lab import (
    HEARD,
    Arm,
    Counter,
    Notebook,
    NoteTaker,
)


def test_a_call_is_checked_carried_out_and_answered_as_declared(host):
    answer = host.call("lab/Arm", "forward", {"joints": [0.0, "0.0"], "scale": 2})
    assert answer.as_json()["pose"]["position"] == {"x": 4.0, "y": 0.0, "z": 0.0}
    assert answer["pose"][0, 3] == 4.0


def test_a_proxy_has_the_signatures_and_returns_single_values_as_they_are(host):
    arm = host.connect("lab/Arm@1.*")
    assert arm.service == "lab/Arm@1.2.0"
    declared = "(joints: 'float64[]', scale: 'float64' = 1.0)"
    assert str(inspect.signature(arm.forward)) == declared
    read = offer_read("forward", host.description("lab/Arm")["methods"]["forward"])
    assert str(read.signature) == declared
    assert arm.forward([0.0])[:3, 3].tolist() == [1.0, 0.0, 0.0]
    assert arm.forward(joints=[0.0], scale=3)[0, 3] == 3.0
    assert arm.forward.__doc__.startswith("Pose of the hand")
    assert arm.stretch([1, 2]).joints.tolist() == [1.0, 2.0]
    with pytest.raises(UnknownTermError, match="did you mean 'forward'"):
        arm.foward([0])
    with pytest.raises(TypeError, match="joints"):
        arm.forward()


def test_a_proxy_calls_later_and_for_many_requests_at_once(host):
    arm = host.connect("lab/Arm@1.*")
    far, near = arm.submit.forward([0.0], scale=3), arm.submit.forward([0.0])
    assert (far.result(60)[0, 3], near.result(60)[0, 3]) == (3.0, 1.0)
    with pytest.raises(UsageError, match="scale: 11 is above 10"):
        arm.submit.forward([0.0], scale=11).result(60)
    requests = [[0.0] * (n % 3 + 1) for n in range(20)]
    found = arm.map.forward(requests, parallel=4)
    assert [pose[0, 3] for pose in found] == [n % 3 + 1 for n in range(20)]
    named = arm.map.forward({"joints": [0.0], "scale": n} for n in range(3))
    assert [pose[0, 3] for pose in named] == [0.0, 1.0, 2.0]
    for way in (arm.submit, arm.map):
        assert way.forward.__doc__.startswith("Pose of the hand")
        with pytest.raises(UnknownTermError, match="did you mean 'forward'"):
            way.foward([0])


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
    with pytest.raises(
        MissingDataError, match=r"needs a dataset for 'model'; give it as data=\{'model': "
    ):
        host.call("lab/Reader", "read")
    with pytest.raises(MissingDataError, match="no dataset robots/Tox; did you mean"):
        host.call("lab/Reader", "read", data={"model": "robots/Tox"})
    with pytest.raises(UsageError, match="expected names of datasets"):
        host.call("lab/Reader", "read", data={"model": 3})
    with pytest.raises(UsageError, match="no data resource 'modl'; did you mean 'model'"):
        host.call("lab/Reader", "read", data={"modl": "robots/Toy"})


def test_a_service_asks_the_graph_and_may_not_write_what_it_only_reads():
    with rtask.open(":memory:", plain=True) as kb, ServiceHost([Counter], kb) as host:
        kb.update("INSERT DATA { <urn:a> <urn:b> <urn:c>, <urn:d> }")
        assert host.call("lab/Counter", "count")["count"] == 2
        with pytest.raises(ForbiddenError, match="declares its graph as read only"):
            host.call("lab/Counter", "note", {"text": "x"})


@pytest.mark.slow
def test_a_service_writes_as_its_caller_follows_the_graph_and_looks_back(tmp_path: Path):
    HEARD.clear()
    with rtask.open(tmp_path / "store") as kb, ServiceHost([NoteTaker], kb) as host:
        nao = Access("nao-1", "robot")
        host.call("lab/NoteTaker", "note", {"text": "first"}, nao)
        seq = kb.seq
        host.call("lab/NoteTaker", "note", {"text": "second"}, nao)
        assert host.call("lab/NoteTaker", "before", {"seq": seq})["texts"] == ["first"]
        both = host.call("lab/NoteTaker", "before", {"seq": kb.seq})["texts"]
        assert both == ["first", "second"]
        assert [change.commit.seq for change in HEARD] == [seq, kb.seq]
        (quad,) = [one for one in kb.match("urn:note") if one.object.value == "first"]
        assert str(quad.graph_name.value).endswith("/graph/agent/nao-1")
    with pytest.raises(MissingDataError, match="needs a graph"), ServiceHost([NoteTaker]) as host:
        host.call("lab/NoteTaker", "before", {"seq": 1})


def test_a_nested_call_keeps_its_deadline_and_a_circle_is_refused(host):
    assert host.call("lab/Detour", "reach", {"joints": [1, 2]})["result"] == 2.0
    with pytest.raises(UsageError, match="a circle of calls: lab/Arm -> lab/Detour -> lab/Arm"):
        host.call("lab/Arm", "ask_again", {"depth": 1})


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

    @method
    def cancel(self) -> None:
        """Leave as a task of asyncio does that was cancelled."""
        raise asyncio.CancelledError


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
            with pytest.raises(ServiceFailedError, match="CancelledError"):
                host.call("lab/Quitter", "cancel", timeout_s=20)
        with pytest.raises(StartupFailedError, match="SystemExit: 2"):
            host.call("lab/Unready", "leave", timeout_s=20)


class Box(Message):
    """A box of parts."""

    labels: list[str]
    width: Annotated[float, Unit("m")]


class Sorter(Service):
    """A service with lists of texts, alone and in a message."""

    name = "lab/Sorter"

    @method(output="names")
    def sort(self, names: list[str], box: Box, more: list[str] | None = None) -> list[str]:
        """Sort names."""
        return sorted([*names, *box.labels, *(more or [])])


def test_lists_of_texts_are_lists_in_ros():
    with ServiceHost([Sorter]) as host:
        _, sort = host.find("lab/Sorter", "sort")
    asked = ros_types("lab/Sort", sort.request)["lab/Sort"]
    assert [str(one) for one in asked] == ["string[]", "lab/SortBox", "string[]"]
    (answered,) = ros_types("lab/Sorted", sort.answer)["lab/Sorted"]
    assert str(answered) == "string[]"


def test_the_description_of_a_service_names_the_fields_of_its_messages():
    loaded = ["service", "show", "lab/Sorter", "--load", "tests.rtask.services.test_services"]
    shown = CliRunner().invoke(cli, loaded).output.splitlines()
    at = next(k for k, line in enumerate(shown) if line.startswith("    box : "))
    assert shown[at + 1 : at + 3] == ["        labels : string[]", "        width : float64  m"]


class Silent(Service):
    """A service that answers nothing."""

    name = "lab/Silent"

    @method
    def use(self) -> None:
        """Be of use."""


def test_a_method_without_a_result_is_answered_by_nothing():
    with ServiceHost([Silent]) as host:
        assert host.call("lab/Silent", "use").as_json() == {}
        assert host.connect("lab/Silent").use().as_json() == {}


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
