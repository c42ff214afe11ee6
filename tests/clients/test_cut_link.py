"""A robot whose link to the server is cut in the middle of every task goes on and loses nothing."""

from __future__ import annotations

import pytest

from tests.benchmarks.endpoint.bench_race import run

pytestmark = pytest.mark.slow  # starts a server


def test_every_task_is_answered_and_every_outcome_reaches_both_graphs() -> None:
    # The deadline is that of a busy machine; how soon answers come is for the benchmark to say.
    found = run(tasks=8, seed=1, deadline_s=20.0)
    assert found["won_by"]["nobody"] == 0
    assert (found["reports"], found["lost"]) == (8, 0)
    assert found["graphs_agree"]
