"""An agent over a table that behaves as told."""

from __future__ import annotations

from typing import Any

import pytest

from features.perception import Perceived
from simulate.agent import second_look
from simulate.agent.agent import Agent, AgentConfig
from tests.simulate.agent.doubles import ASKED_PLACES, Body, Server, seen_at


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch):
    """Run an agent over a table and return (agent, encounters)."""

    def _run(
        body: Body, server: Server, order: list[tuple[float, float]],
        on_event=lambda name, data: None, see=None, on_sight=lambda encounter, seen: None, **config
    ):  # fmt: skip
        ASKED_PLACES[:] = order

        def everything(*_: Any) -> Perceived:
            return Perceived("ok", 0.27, tuple(seen_at(x, y) for x, y in body.table))

        monkeypatch.setattr(second_look, "perceive", see or everything)
        agent = Agent(body, server, AgentConfig(**config), on_event, on_sight)
        return agent.clear_table()

    return _run
