"""Workers that are processes: values that travel, workers that die, hang or are cancelled."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from rtask.errors import (
    CancelledError,
    DeadlineError,
    ForbiddenError,
    ServiceError,
    UsageError,
    WorkerDiedError,
)
from rtask.kb.commit.access import Access
from rtask.services import Service, ServiceHost, data_resource, method
from rtask.services.call import Invocation
from rtask.services.definition import define
from rtask.services.registry import load
from tests.rtask.services.elsewhere import CallsElsewhere
from tests.rtask.services.lab import ApartNotebook, Fragile, Notebook, Writer

pytestmark = pytest.mark.slow  # starts processes


@pytest.fixture(scope="module")
def host() -> Iterator[ServiceHost]:
    with ServiceHost([Fragile, Writer]) as opened:
        yield opened


class TestCallsInProcesses(CallsElsewhere):
    """Calls whose process is on this machine."""

    service = "lab/Fragile"


def test_a_worker_that_is_killed_while_writing_is_an_error_and_is_not_repeated(
    host, tmp_path: Path
):
    host.datasets.create("lab/Store")
    before = host.datasets.find("lab/Store@head").digest
    with pytest.raises(WorkerDiedError, match="ended with exit code -9"):
        host.call(
            "lab/Writer", "write", {"marker": str(tmp_path / "m")}, data={"store": "lab/Store"}
        )
    assert (tmp_path / "m").read_text() == "x"
    assert host.datasets.find("lab/Store@head").digest == before


def test_a_worker_that_is_killed_from_outside_does_not_hurt_later_calls(host):
    def turn() -> int:
        given = {"pose": np.eye(4), "image": b""}
        pid: int = host.call("lab/Fragile", "turn", given)["pid"]
        return pid

    first = turn()
    os.kill(first, signal.SIGKILL)
    assert turn() != first


def test_what_hangs_is_killed_at_its_deadline_and_the_next_call_is_answered(host):
    with pytest.raises(DeadlineError):
        host.call("lab/Fragile", "hang", timeout_s=0.2)
    given = {"pose": np.eye(4), "image": b""}
    assert host.call("lab/Fragile", "turn", given)["pid"]


def test_what_hangs_is_killed_when_it_is_cancelled(host):
    task = host.submit(Invocation("lab/Fragile", "hang", timeout_s=300))
    threading.Timer(0.3, task.cancel).start()
    with pytest.raises((CancelledError, WorkerDiedError)):
        task.result()


def test_a_service_from_a_file_runs_in_processes(tmp_path: Path):
    file = tmp_path / "apart.py"
    file.write_text(
        "import os\n"
        "from rtask.services import Service, method\n"
        "class Apart(Service):\n"
        "    '''Apart.'''\n"
        "    name, executor = 'lab/Apart', 'processes'\n"
        "    @method\n"
        "    def pid(self) -> int:\n"
        "        '''Who it is.'''\n"
        "        return os.getpid()\n",
        "utf-8",
    )
    with ServiceHost(load(str(file))) as host:
        assert host.call("lab/Apart", "pid")["result"] != os.getpid()


@pytest.mark.parametrize("service", [Notebook, ApartNotebook])
def test_what_a_call_writes_is_stored_when_it_returns_and_not_when_it_fails(service):
    with ServiceHost([service]) as host:
        host.datasets.create("lab/Book", Access("alice", "robot"))
        alice, bob = Access("alice", "robot"), Access("bob", "robot")
        data = {"store": "lab/Book"}
        notes = host.connect(service.name, data, alice)
        assert notes.add(5) == 5
        with pytest.raises(ServiceError, match=r"^no$"):
            notes.add(10, fail=True)
        assert notes.add(1) == 6
        if service is Notebook:  # which takes no process for each call
            with pytest.raises(ForbiddenError, match="belongs to alice"):
                host.connect(service.name, data, bob).add(1)
        assert host.datasets.read("lab/Book@head", "sum") == b"6"


def test_the_graph_stays_in_its_process():
    class Asking(Service):
        """A mistake."""

        name, executor = "lab/Asking", "processes"
        graph = data_resource("graph")

        @method
        def ask(self) -> None:
            """Ask."""

    with pytest.raises(UsageError, match="the graph is in this process; use threads"):
        define(Asking)
