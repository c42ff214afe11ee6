"""Services on a Ray cluster: values that travel, actors that die, and no cluster that nobody named.

All but the last test need the package ``ray``; they start a cluster of their own for a moment.
"""

from __future__ import annotations

import importlib
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtask.errors import (
    CancelledError,
    DeadlineError,
    StartupFailedError,
    UsageError,
    WorkerDiedError,
)
from rtask.services import Service, ServiceHost, data_resource, method
from rtask.services.call import Invocation
from rtask.services.datasets.store import Datasets
from rtask.services.definition import define
from tests.rtask.services.elsewhere import CallsElsewhere
from tests.rtask.services.endings.moments import Gate, RayTally
from tests.rtask.services.endings.test_endings import ENDS, STORE, check
from tests.rtask.services.lab import Fragile, Notebook, Writer

pytestmark = pytest.mark.slow  # starts processes

_REASON = "ray is optional: pip install '.[ray]'"


class FarFragile(Fragile):
    """A service that can die, on the cluster."""

    name = "lab/FarFragile"
    executor = "ray"
    max_workers = 1


class FarWriter(Writer):
    """A service that dies and may have written, on the cluster."""

    name = "lab/FarWriter"
    executor = "ray"


class FarNotebook(Notebook):
    """A service that keeps a count in its data, on the cluster."""

    name = "lab/FarNotebook"
    executor = "ray"


@pytest.fixture(scope="module")
def cluster() -> Iterator[None]:
    ray = pytest.importorskip("ray", reason=_REASON)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ray.init(num_cpus=4, include_dashboard=False, logging_level="ERROR", log_to_driver=False)
        try:
            yield
        finally:
            ray.shutdown()


@pytest.fixture(scope="module")
def host(cluster: None) -> Iterator[ServiceHost]:
    with ServiceHost([FarFragile, FarWriter, FarNotebook]) as opened:
        yield opened


@pytest.fixture(scope="module")
def sum_host(cluster: None) -> Iterator[ServiceHost]:
    with ServiceHost([RayTally], check_every=1) as made:
        made.datasets.create(STORE)
        made.datasets.put(STORE, {"sum": b"1"})
        yield made


class TestCallsOnTheCluster(CallsElsewhere):
    """Calls whose process is an actor of Ray."""

    service = "lab/FarFragile"


@pytest.mark.parametrize("moment", ["waiting", "after it wrote", "returned", "stored"])
@pytest.mark.parametrize("cause", ENDS)
def test_what_is_stored_is_what_the_caller_was_told(
    sum_host: ServiceHost, gate: Gate, tmp_path: Path, cause: str, moment: str
) -> None:
    check(sum_host, RayTally.name, cause, moment, tmp_path, gate)


def test_what_hangs_is_killed_when_it_is_late_or_cancelled(host):
    with pytest.raises(DeadlineError):
        host.call("lab/FarFragile", "hang", timeout_s=0.5)
    task = host.submit(Invocation("lab/FarFragile", "hang", timeout_s=300))
    threading.Timer(0.5, task.cancel).start()
    with pytest.raises((CancelledError, WorkerDiedError)):
        task.result()
    image = {"pose": np.eye(4), "image": b""}
    assert host.call("lab/FarFragile", "turn", image, timeout_s=120)["pid"]


def test_what_a_call_writes_is_stored_when_it_returns_and_not_when_it_dies(host, tmp_path: Path):
    host.datasets.create("lab/Store")
    data = {"store": "lab/Store"}
    assert host.call("lab/FarNotebook", "add", {"number": 4}, data=data)["result"] == 4
    assert host.call("lab/FarNotebook", "add", {"number": 3}, data=data)["result"] == 7
    assert host.datasets.read("lab/Store", "sum") == b"7"
    marker = tmp_path / "tries"
    with pytest.raises(WorkerDiedError):
        host.call("lab/FarWriter", "write", {"marker": str(marker)}, data=data)
    assert marker.read_text() == "x", "it was not tried again"
    assert list(host.datasets.find("lab/Store").files) == ["sum"]


def test_no_cluster_is_started_that_nobody_named(monkeypatch: pytest.MonkeyPatch):
    class Named:
        """The module, as far as it is asked before there is a connection."""

        @staticmethod
        def is_initialized() -> bool:
            return False

    imported = importlib.import_module

    def import_module(name: str, package: str | None = None) -> Any:
        return Named if name == "ray" else imported(name, package)

    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setattr(importlib, "import_module", import_module)
    with (
        ServiceHost([FarFragile], datasets=Datasets(None)) as alone,
        pytest.raises(StartupFailedError, match="address of a running cluster"),
    ):
        alone.call("lab/FarFragile", "crash")


def test_the_graph_stays_in_its_process():
    class Far(Service):
        """A service that asks the graph."""

        name = "lab/Far"
        executor = "ray"
        graph = data_resource("graph")

        @method
        def ask(self) -> int:
            """Ask."""
            return 1

    with pytest.raises(UsageError, match="the graph is in this process"):
        define(Far)
