"""A robot that does not grasp says why, in the graph."""

from __future__ import annotations

from pathlib import Path

import pytest

import ontology
import rtask
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.decisions import Thresholds
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.demo.queries import QUESTIONS, with_prefixes
from simulate.robots import describe
from simulate.world.objects import product
from simulate.world.scene import Placement


@pytest.mark.slow
def test_why_a_robot_left_a_can_alone_is_answered_by_the_store(tmp_path: Path) -> None:
    """Camera and engine as they are; the task asks for more than any grasp promises."""
    place = describe("nao").workplace
    can = Placement(product("can", 3), sum(place.area_x) / 2, -0.12, 0.0)
    body = SimulatedBody([can], tmp_path, Conditions(preset="fast"))
    (query,) = [path for path in ontology.episode_queries() if path.stem == "eq24"]
    try:
        with rtask.open(":memory:") as kb, rtask.connect(kb, agent="nao-1") as client:
            client.call("register_robot", **body.robot.describe("nao-1"))
            config = AgentConfig(thresholds=Thresholds(grasp=1.0))
            (met,) = Agent(body, client, config).clear_table()
            (row,) = kb.select(query.read_text("utf-8")).to_dicts()
            (asked,) = kb.select(with_prefixes(QUESTIONS[-1].sparql)).to_dicts()
    finally:
        body.close()
    assert [(one.reason, one.physical) for one in met.attempts] == [("refused", False)]
    (refusal,) = met.refusals
    assert (row["robot"], row["lacking"], row["required"]) == ("nao-1", "grasp", 1.0)
    assert row["found"] == pytest.approx(refusal.confidence, abs=1e-6)
    assert row["then"] == refusal.response == "left_alone"
    assert (asked["robot"], asked["lacking"], asked["then"]) == ("nao-1", "grasp", "left_alone")
    assert 0 < asked["found"] < 1
