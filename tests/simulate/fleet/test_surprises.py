"""Surprises between the look and the grasp: objects that move or go, in real physics."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest

import rtask
from simulate.agent.agent import Agent, AgentConfig, Server
from simulate.agent.encounter import Encounter
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.world.objects import product
from simulate.world.scene import Placement

Meddle = Callable[[SimulatedBody], None]


@pytest.fixture
def body(tmp_path: Path) -> Iterator[SimulatedBody]:
    """A robot before one can, in the coarse physics: nothing here depends on how well it holds."""
    can = Placement(product("can", 3), 0.15, -0.10, 0.0)
    made = SimulatedBody([can], tmp_path, Conditions(preset="fast"))
    yield made
    made.close()


def _clear(body: SimulatedBody, meddle: Meddle) -> list[Encounter]:
    """Let a robot clear its table while somebody meddles before its first grasp."""
    execute, meddled = body.execute, []

    def surprised(plan: Any) -> Any:
        if not meddled:
            meddled.append(True)
            meddle(body)
        return execute(plan)

    body.execute = surprised  # type: ignore[method-assign]
    with rtask.open(":memory:", reason=False) as kb, rtask.connect(kb, agent="robot") as client:
        client.call("register_robot", **body.robot.describe("robot"))
        return Agent(body, cast(Server, client), AgentConfig(max_attempts=3)).clear_table()


@pytest.mark.deep
@pytest.mark.slow
def test_an_object_that_is_moved_is_missed_looked_for_and_taken_where_it_is(
    body: SimulatedBody,
) -> None:
    def move(body: SimulatedBody) -> None:
        world, (laid,) = body.world, body.laid
        pose = world.object_pose(laid.body)
        to = (pose.x, pose.y + 0.06, pose.z)
        world.client.resetBasePositionAndOrientation(laid.body, to, pose.quaternion)

    (met,) = _clear(body, move)
    assert met.attempts[0].reason == "missed"
    assert not met.attempts[0].held
    assert met.tries >= 2
    assert any(attempt.reason != "missed" for attempt in met.attempts[1:])


@pytest.mark.slow
def test_an_object_that_is_taken_away_is_missed_once_and_not_waited_for(
    body: SimulatedBody,
) -> None:
    def take(body: SimulatedBody) -> None:
        body.world.remove(body.laid[0].body)

    (met,) = _clear(body, take)
    assert [(a.reason, a.held, a.placed) for a in met.attempts] == [("missed", False, False)]
