"""Questions about what happened, answered by what simulated robots did, met and lost."""

from __future__ import annotations

import pytest

import ontology
import rtask
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.robots import describe
from simulate.world.objects import product
from simulate.world.scene import Placement

pytestmark = pytest.mark.slow

PLACE = describe("panda").workplace
X, Y = sum(PLACE.area_x) / 2, -sum(PLACE.area_abs_y) / 2
CAN, BOX = product("can", 3), product("box", 174)
AWAY = (PLACE.table_near + 0.4, 0.3, 0.25)


class OneSide(Agent):
    """Looks at the right half of the table only, to save time."""

    def clear_table(self):
        self._clear_side("right")
        return list(self.encounters.values())


class Robbed(SimulatedBody):
    """Loses what it grasps after a phase of each attempt in turn, and finds it back in its place.

    None = nothing happens in that attempt.
    """

    def __init__(self, placements, assets, phases):
        super().__init__(placements, assets, Conditions("panda", "fast"))
        self.phases = list(phases)

    def execute(self, plan):
        physics = self.world.client
        stood = {one.body: physics.getBasePositionAndOrientation(one.body) for one in self.laid}
        taken = min(stood, key=lambda body: abs(stood[body][0][1] - plan.request.y))
        after = self.phases.pop(0)

        def on_phase(phase):
            if phase == after:
                physics.resetBasePositionAndOrientation(taken, AWAY, (0, 0, 0, 1))

        self.watch = lambda plan: on_phase
        record = super().execute(plan)
        if after is not None:
            physics.resetBasePositionAndOrientation(taken, *stood[taken])
            physics.resetBaseVelocity(taken, (0, 0, 0), (0, 0, 0))  # it had been falling
            self.world.step(0.2)  # an unchanged scene is viewed only once
        return record


def work(kb, name, assets, placements, phases, config):
    """Let a Panda that is robbed clear its side."""
    body = Robbed(placements, assets, phases)
    try:
        with rtask.connect(kb, agent=name) as client:
            client.call("register_robot", **body.robot.describe(name))
            return OneSide(body, client, config).clear_table()
    finally:
        body.close()


@pytest.fixture(scope="module")
def kb(tmp_path_factory):
    """A graph of two Pandas.

    The first lets a can fall beside its box and then places it. The second loses the can on the way
    to the box, and never holds a box that is taken away as the hand lifts.
    """
    assets = tmp_path_factory.mktemp("assets")
    with rtask.open(":memory:") as opened:
        work(opened, "panda-1", assets, [Placement(CAN, X, Y, 0.0)], ["place", None], AgentConfig())
        table = [Placement(CAN, X, Y, 0.0), Placement(BOX, X - 0.08, Y - 0.1, 0.6)]
        work(opened, "panda-2", assets, table, ["lift", "hold"], AgentConfig(max_attempts=1))
        yield opened


def answer(kb, number):
    """Return the rows of an episode question."""
    (query,) = [path for path in ontology.episode_queries() if path.stem == f"eq{number:02}"]
    return kb.select(query.read_text("utf-8")).to_dicts()


def name_of(row):
    return str(row["reason"]).rpartition("reason_")[2]


def test_what_was_held_and_lost_on_the_way_says_how(kb):
    found = [(row["robot"], row["object"], name_of(row)) for row in answer(kb, 13)]
    assert found == [
        ("panda-1", "cylinder 1", "drop_outside"),
        ("panda-2", "cylinder 1", "slip_transport"),
    ]


def test_a_grasp_that_one_robot_lost_and_another_held_is_found(kb):
    found = [(row["object"], row["lostBy"], row["heldBy"]) for row in answer(kb, 10)]
    assert found == [("cylinder 1", "panda-2", "panda-1")]


def test_what_was_tried_and_never_held_is_found(kb):
    assert [(row["object"], int(row["attempts"])) for row in answer(kb, 12)] == [("box 2", 1)]


def test_attempts_of_a_robot_follow_one_another_and_what_was_seen_before(kb):
    rows = answer(kb, 20)
    assert [row["robot"] for row in rows] == ["panda-1"] * 2 + ["panda-2"] * 2
    times = [str(row[name]) for row in rows for name in ("started", "ended")]
    assert times == sorted(times)
    seen = {str(row["ended"]): str(row["seen"]) for row in answer(kb, 15)}
    assert len(seen) == 4
    assert all(seen[str(row["ended"])] < str(row["started"]) for row in rows)
