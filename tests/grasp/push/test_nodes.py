"""The figures about many nodes (Kehoe 2014, Fig. 3.17 to 3.19, Table 3.2) can still be made."""

from __future__ import annotations

import numpy as np
import pytest

from grasp.push import open_executor
from simulate.thesis.runs import push_nodes as nodes


def test_every_nodes_shard_is_timed_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nodes, "SAMPLES", 6)
    trials = nodes.trials_of("A", nodes.CONFIGURATIONS[-1], 0)
    with open_executor("serial") as executor:
        times = nodes.shard_times(executor, trials, 3)
    assert times.shape == (3,)
    assert np.all(times > 0)
