"""Two makes of robot on one graph: the large one finds and uses what the small one learnt."""

from __future__ import annotations

import pytest

import rtask
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.robots import describe
from simulate.world.objects import product
from simulate.world.scene import Placement

pytestmark = pytest.mark.slow

BOX = product("box", 174)


class OneSide(Agent):
    """Looks at the right half of the table only, to save time."""

    def clear_table(self):
        self._clear_side("right")
        return list(self.encounters.values())


def meet(kb, robot, assets, yaw):
    """Let a robot of a make clear a table with one box; return what happened to it."""
    place = describe(robot).workplace
    x, y = sum(place.area_x) / 2, -sum(place.area_abs_y) / 2
    body = SimulatedBody([Placement(BOX, x, y, yaw)], assets, Conditions(robot=robot))
    asked = []
    try:
        with rtask.connect(kb, agent=f"{robot}-1") as client:
            client.call("register_robot", **body.robot.describe(f"{robot}-1"))
            real = client.recognise_for_grasp

            def ask(**request):
                asked.append(real(**request))
                return asked[-1]

            client.recognise_for_grasp = ask
            (encounter,) = OneSide(body, client, AgentConfig(max_attempts=3)).clear_table()
    finally:
        body.close()
    return encounter, asked


@pytest.fixture(scope="module")
def kb():
    with rtask.open(":memory:") as opened:
        yield opened


@pytest.mark.deep  # that the next robot profits is tested in make test by a demo of two alike
def test_a_nao_learns_and_a_panda_profits(kb, tmp_path):
    learnt, _ = meet(kb, "nao", tmp_path, yaw=0.6)
    assert learnt.held
    assert learnt.recognised == ""
    # Its camera stands on the other side of the table: so turned, it sees the same faces.
    profits, asked = meet(kb, "panda", tmp_path, yaw=-1.43)
    assert profits.recognised == learnt.object_iri
    assert profits.held
    # What the weaker hand held comes first, at full weight.
    first = asked[0]["grasps"][0]
    assert first["source"] == "memory"
    assert first["explanation"]["graph"][0] == pytest.approx(1.0, abs=0.1)
    assert profits.attempts[0].source == "memory"
    able = "PREFIX rt: <https://w3id.org/rtask-kg/ns#> SELECT ?r { ?r rt:canGrasp ?o }"
    robots = {str(row["r"].value).rpartition("/")[2] for row in kb.select(able)}
    assert {"nao-1", "panda-1"} <= robots
