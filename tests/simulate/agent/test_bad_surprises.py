"""Every failure on the way has its reason code, and a world that broke down says so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import rtask
from rtask.errors import RobotError
from simulate.act.service import ActService
from simulate.agent.agent import Agent, AgentConfig
from simulate.agent.scoring import AttemptTruth
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.grasping.executor import GraspRequest, Workcell
from simulate.world.objects import product
from simulate.world.scene import Placement

CAN = product("can", 3)
AT = (0.47, -0.10)


@pytest.fixture(scope="module")
def cell():
    """A Panda: whoever carries out a plan is the same code for all robots."""
    with Workcell("panda") as made:
        yield made


@pytest.fixture
def can(cell):
    body = cell.world.spawn(CAN, AT)
    cell.world.step(0.2)
    yield body
    for other in list(cell.world.objects):
        cell.world.remove(other)
    cell.robot.reset_arm("panda_arm", cell.robot.home("panda_arm"))
    cell.robot.rest_hand("panda_arm")
    cell.world.step(0.5)


def plan_of(cell):
    diameter, height = CAN.dims
    request = GraspRequest(
        *AT, 0.0, width=diameter, length=diameter, height=height, round=True,
        table_height=cell.world.table_height,
    )  # fmt: skip
    plan = cell.executor.plan(request, seed=1)
    assert not isinstance(plan, str)
    return plan


def run(cell, phase, happens):
    """Carry out the plan; ``happens`` at the end of a phase."""
    return cell.executor.execute(
        plan_of(cell), on_phase=lambda name: happens() if name == phase else None
    )


@pytest.mark.slow
def test_an_object_taken_away_during_the_approach_is_missed(cell, can):
    record = run(cell, "pregrasp", lambda: cell.world.remove(can))
    assert (record.reason, record.held, record.links_touching) == ("missed", False, 0)
    assert record.lifted_m == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow
def test_an_object_that_moves_during_the_approach_is_missed(cell, can):
    def move():
        cell.world.client.resetBasePositionAndOrientation(can, (0.47, 0.15, 0.24), (0, 0, 0, 1))

    plan = plan_of(cell)
    watch = AttemptTruth(cell.world, cell.robot, plan)

    def on_phase(phase):
        if phase == "pregrasp":
            move()
        watch(phase)

    record = cell.executor.execute(plan, on_phase)
    assert record.reason == "missed"
    assert watch.truth.pushed_m > 0.015  # it stood elsewhere when the hand closed


@pytest.mark.slow
def test_an_object_taken_from_the_hand_in_transport_is_named(cell, can):
    record = run(cell, "transport", lambda: cell.world.remove(can))
    assert (record.held, record.placed) == (True, False)
    assert record.place_reason in {"drop_outside", "slip_transport"}


@pytest.mark.slow
def test_a_hand_that_does_not_close_is_hardware(cell, can, monkeypatch):
    real = cell.robot.move_fingers

    def jammed(arm, opening, effort):
        if opening > 0:
            real(arm, opening, effort)

    monkeypatch.setattr(cell.robot, "move_fingers", jammed)
    assert cell.executor.execute(plan_of(cell)).reason == "hardware"


@pytest.mark.slow
def test_an_object_nearly_as_wide_as_the_open_hand_is_held(cell, can):
    mouth = cell.robot.arm("panda_arm").mouth
    opening = (CAN.dims[0] + 0.003) / mouth
    plan = replace(plan_of(cell), opening=opening)
    record = cell.executor.execute(plan)
    assert opening - record.jaw_gap_m / mouth < 0.05  # what a stuck hand moves at most
    assert (record.reason, record.held) == ("ok", True)


@pytest.mark.slow
def test_a_hand_that_does_not_open_is_hardware_and_touches_nothing(cell, can, monkeypatch):
    cell.robot.move_fingers("panda_arm", 0.0, 15.0)
    cell.world.step(0.8)
    monkeypatch.setattr(cell.robot, "move_fingers", lambda arm, opening, effort: None)
    record = cell.executor.execute(plan_of(cell))
    assert record.reason == "hardware"
    assert "approach" not in record.times
    assert cell.world.object_pose(can).position[:2] == pytest.approx(AT, abs=0.002)


def test_plans_keep_to_the_joints_limits(cell):
    chain = cell.robot.chains["panda_arm"]
    for dx, dy in ((0.0, 0.0), (0.07, 0.25), (-0.05, -0.08)):
        request = GraspRequest(AT[0] + dx, AT[1] + dy, 1.2, table_height=cell.world.table_height)
        plan = cell.executor.plan(request, seed=2)
        assert not isinstance(plan, str)
        for way in (plan.free, plan.approach, plan.lift):
            assert (way.positions >= chain.lower - 1e-6).all()
            assert (way.positions <= chain.upper + 1e-6).all()
            assert (np.abs(way.velocities) <= chain.velocity * 1.001).all()


@pytest.mark.slow
def test_a_world_that_breaks_down_names_the_joint(cell, can, monkeypatch):
    real, broken = cell.robot.arm_joints, []

    def joints(arm):
        values = real(arm)
        if broken:
            values[3] = math.nan
        return values

    monkeypatch.setattr(cell.robot, "arm_joints", joints)
    with pytest.raises(RobotError, match="panda_joint4 of panda is not a number") as caught:
        run(cell, "pregrasp", lambda: broken.append(True))
    assert caught.value.details["reason"] == "not_judged"


@pytest.mark.slow
def test_an_object_taken_away_between_look_and_grasp_is_missed_once_and_told(tmp_path):
    """Camera, engine, planner and physics as they are; only somebody's hand is quicker."""
    body = SimulatedBody(
        [Placement(CAN, *AT, 0.0)], tmp_path, Conditions(robot="panda", preset="fast")
    )
    real = body.execute

    def too_late(plan):
        for left in list(body.world.objects):
            body.world.remove(left)
        return real(plan)

    body.execute = too_late
    try:
        with rtask.open(":memory:") as kb, rtask.connect(kb, agent="panda-1") as client:
            client.call("register_robot", **body.robot.describe("panda-1"))
            (met,) = Agent(body, client, AgentConfig()).clear_table()
            told = kb.select(
                "PREFIX rt: <https://w3id.org/rtask-kg/ns#> SELECT ?code { "
                "?attempt rt:hasOutcome ?outcome . ?outcome rt:hasReason/rt:code ?code }"
            )
            codes = [str(row.value("code")) for row in told]
    finally:
        body.close()
    assert [(a.reason, a.held) for a in met.attempts] == [("missed", False)]
    assert codes == ["missed"]


def test_the_act_service_passes_a_breakdown_on(cell, can, monkeypatch):
    service = ActService(cell)
    monkeypatch.setattr(cell.robot, "arm_joints", lambda arm: np.full(7, math.nan))
    with pytest.raises(RobotError, match="make a new world"):
        service.act(
            {
                "action_type": "grasp",
                "goal_pose": {
                    "position": {"x": AT[0], "y": AT[1], "z": 0.235},
                    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                },
            }
        )
    monkeypatch.undo()
    assert service.act({"action_type": "home"})["success"] == 1
