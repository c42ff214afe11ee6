"""Checks of calls that run in another process, wherever that process is."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from rtask.errors import ServiceFailedError
from rtask.services import ServiceHost
from rtask.services.call import Invocation

__all__ = ["CallsElsewhere"]


class CallsElsewhere:
    """A call's values, progress and errors travel; a pure call survives the death of its worker.

    Tests derive from it, name the service and have a fixture ``host`` that offers it.
    """

    service: str
    """Name under which :class:`tests.rtask.services.lab.Fragile` is offered"""

    def test_values_and_progress_travel_there_and_back(self, host: ServiceHost) -> None:
        pose = np.eye(4)
        pose[:3, 3] = 1.0, 2.0, 3.0
        task = host.prepare(Invocation(self.service, "turn", {"pose": pose, "image": b"\0\1"}))
        seen: list[tuple[float, str]] = []
        task.call.on_progress(lambda *progress: seen.append(progress))
        host.start(task)
        answer = task.result()
        np.testing.assert_array_equal(answer["pose"], pose)
        assert answer["image"] == b"\0\1"
        assert answer["pid"] != os.getpid()
        assert seen == [(0.5, "half")]

    def test_a_worker_that_dies_in_a_pure_call_is_replaced_and_the_call_given_again(
        self, host: ServiceHost, tmp_path: Path
    ) -> None:
        answer = host.call(self.service, "die_once", {"marker": str(tmp_path / "died")})
        assert (tmp_path / "died").exists()
        assert answer["result"] not in (0, os.getpid())

    def test_an_error_has_its_class_and_words(self, host: ServiceHost) -> None:
        with pytest.raises(ServiceFailedError, match="KeyError: 'nothing'"):
            host.call(self.service, "crash")
