"""Each hand's map from scores to chances grows from its own outcomes, and is rebuilt from them."""

from __future__ import annotations

import pytest

from grasp.learning.calibration import fit_map
from rtask.engine.memory.calibration import PLANAR, own_outcomes, score_maps
from rtask.kb.commit.access import Access

pytestmark = pytest.mark.slow


def _hand(engine, name="right_hand", robot="nao-1"):
    return engine.context.grippers.find(name, Access(robot, "robot"))


def _told(engine):
    return own_outcomes(engine.context, _hand(engine).iri)


def fill_store(bench, robots):
    """Let a robot try grasps of a box twelve times, each third in vain."""
    robot = robots()
    seen = bench.sight(bench.BOX)
    grasps = robot.recognise(seen)["grasps"]
    stored = robot.insert(seen, grasp=grasps[0], outcome=bench.held(), name="tea box")
    for k in range(11):
        robot.call(
            "report_outcome", task_id=f"urn:try:{k}", object=stored["objects"][0]["object"],
            grasp=grasps[k % 3], gripper_id="right_hand",
            outcome=bench.missed() if k % 3 == 0 else bench.held(),
        )  # fmt: skip


@pytest.fixture
def tried(bench, engine, filled):
    """A robot that has tried grasps of a box twelve times, and what it saw of it."""
    return bench.Robot("nao-1", engine), bench.sight(bench.BOX)


def test_a_stored_map_is_the_one_that_its_outcomes_give(engine, tried):
    told = [one for one in _told(engine) if one.kind == PLANAR]
    assert len(told) == 12
    assert sum(one.held for one in told) == 8
    stored, rebuilt = (
        score_maps(engine.context, _hand(engine))[PLANAR],
        fit_map((one.score, one.held) for one in told),
    )
    assert stored.outcomes == rebuilt.outcomes == 12
    for a, b in (
        (stored.offset, rebuilt.offset), (stored.slope, rebuilt.slope),
        (stored.variances[0], rebuilt.variances[0]), (stored.variances[1], rebuilt.variances[1]),
        (stored.covariance, rebuilt.covariance),
    ):  # fmt: skip
        assert a == pytest.approx(b, abs=1e-9)


def test_one_map_is_left_in_the_robots_own_graph(kb, tried):
    rows = kb.query("""
        PREFIX rt: <https://w3id.org/rtask-kg/ns#>
        SELECT ?map ?graph ?n ?offset { GRAPH ?graph {
          ?map a rt:ScoreCalibration ; rt:outcomeCount ?n ; rt:calibrationOffset ?offset } }""")
    (row,) = [row.to_dict() for row in rows]
    assert row["n"] == 12
    assert row["graph"].endswith("/graph/agent/nao-1")


def test_failures_lower_what_scores_are_worth(engine, tried):
    found = score_maps(engine.context, _hand(engine))[PLANAR]
    assert found.chance(0.9) < 0.9


def test_a_verdict_moves_the_map_to_what_the_outcomes_are_now(engine, tried):
    before = score_maps(engine.context, _hand(engine))[PLANAR]
    engine.call(
        "give_feedback", {"task_id": "urn:try:1", "verdict": "refuse"}, Access("ann", "teacher")
    )
    after = score_maps(engine.context, _hand(engine))[PLANAR]
    assert after.offset < before.offset
    assert after.outcomes == 12


def test_rebuilding_restores_a_map_that_was_damaged(engine, kb, tried):
    before = score_maps(engine.context, _hand(engine))[PLANAR]
    with kb.transaction() as tx:
        tx.update("""PREFIX rt: <https://w3id.org/rtask-kg/ns#>
            DELETE { GRAPH ?g { ?map rt:calibrationOffset ?a } }
            INSERT { GRAPH ?g { ?map rt:calibrationOffset 3.0e0 } }
            WHERE { GRAPH ?g { ?map rt:calibrationOffset ?a } }""")
    assert score_maps(engine.context, _hand(engine))[PLANAR].offset == 3.0
    engine.rebuild_statistics()
    assert score_maps(engine.context, _hand(engine))[PLANAR] == before


def test_another_robots_hand_has_no_map_of_it(engine, tried, robots):
    robots("nao-2")
    assert score_maps(engine.context, _hand(engine, robot="nao-2")) == {}
