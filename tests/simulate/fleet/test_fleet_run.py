"""A whole fleet: real processes, a server that goes away, a robot that is killed."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest

import rtask
from rtask.client.outbox import Outbox
from rtask.errors import UsageError
from simulate.fleet.assignment import plan_fleet
from simulate.fleet.figures import (
    COLUMNS,
    fleet_figures,
    fleet_rows,
    sharing_gain,
    write_fleet_report,
)
from simulate.fleet.orchestrate import Fleet, FleetSettings

ATTEMPTS = """
PREFIX rt: <https://w3id.org/rtask-kg/ns#>
SELECT ?robot (COUNT(DISTINCT ?attempt) AS ?n) (COUNT(DISTINCT ?graph) AS ?graphs) {
  GRAPH ?graph { ?attempt rt:hasOutcome ?outcome }
  ?attempt rt:performedBy/rt:name ?robot
} GROUP BY ?robot ORDER BY ?robot
"""


@pytest.mark.deep
@pytest.mark.slow
def test_what_a_robot_reports_is_stored_once_in_its_own_graph(tmp_path: Path) -> None:
    told: list[dict[str, Any]] = []
    settings = FleetSettings(
        tmp_path / "fleet", robots=1, objects=2, on_table=2, seed=8, in_line=False,
        max_attempts=1, preset="fast",
    )  # fmt: skip
    fleet = Fleet(settings, lambda _, event: told.append(event))
    done = fleet.run()
    (robot,) = done["robots"]
    assert (robot["lost"], robot["undelivered"], len(robot["tables"])) == ("", 0, 1)
    reported = [e for e in told if e["event"] == "attempt" and e["source"] != "none"]
    with rtask.open(tmp_path / "fleet" / "store-1") as kb:
        rows = [(int(r.value("n")), int(r.value("graphs"))) for r in kb.select(ATTEMPTS)]
    assert rows == ([(len(reported), 1)] if reported else [])
    figures = fleet_figures(done, fleet.plan)
    assert figures["robots"][0]["tried"] <= 2
    assert {len(row) for row in fleet_rows(figures)} == {len(COLUMNS)}
    write_fleet_report(tmp_path / "report", [("shared", done, figures)])
    assert (tmp_path / "report" / "report.json").exists()


@pytest.mark.deep
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_server_that_comes_back_and_a_robot_that_does_not(tmp_path: Path) -> None:
    """Both work at once on two objects; the endpoint is killed once, then the second robot.

    The first is late besides: it stands still before its table until the second is gone.
    """
    told: list[tuple[str, dict[str, Any]]] = []
    killed: list[str] = []

    def meddle(robot: str, event: dict[str, Any]) -> None:
        told.append((robot, event))
        if event["event"] == "grasping" and "endpoint" not in killed:
            killed.append("endpoint")
            os.kill(fleet.endpoints[0].endpoint.process.pid, signal.SIGKILL)
        if robot == "robot-1" and event["event"] == "ready":
            os.kill(fleet.robots[0].process.pid, signal.SIGSTOP)
        if robot == "robot-2" and event["event"] == "attempt" and "robot" not in killed:
            killed.append("robot")
            os.kill(fleet.robots[1].process.pid, signal.SIGKILL)
            fleet.robots[1].process.wait()
            late = {"task_id": "urn:late", "object": "urn:nobody", "success": True}
            Outbox(outbox).add("report_outcome", late)
        if robot == "robot-2" and event["event"] == "lost":
            os.kill(fleet.robots[0].process.pid, signal.SIGCONT)

    outbox = tmp_path / "fleet" / "robot-2.outbox.jsonl"
    settings = FleetSettings(
        tmp_path / "fleet", robots=2, objects=2, on_table=2, seed=8, in_line=False,
        max_attempts=2, preset="fast",
    )  # fmt: skip
    fleet = Fleet(settings, meddle)
    done = fleet.run()
    first, second = done["robots"]
    assert killed == ["endpoint", "robot"]
    assert [e["event"] for r, e in told if r == "the endpoint"] == ["restart"]

    assert (first["lost"], first["undelivered"], len(first["tables"])) == ("", 0, 1)
    assert "robot-2 disappeared while" in second["lost"]
    assert "SIGKILL" in second["lost"]
    # What it had not told yet is told for it; the server takes none of this made-up outcome.
    assert (second["undelivered"], Outbox(outbox).pending()) == (0, [])
    assert "urn:late" in outbox.with_name(outbox.name + ".refused").read_text()

    # Everything that was reported is there once, in its robot's own graph.
    reported = {
        name: sum(
            1 for r, e in told if r == name and e["event"] == "attempt" and e["source"] != "none"
        )
        for name in ("robot-1", "robot-2")
    }
    with rtask.open(tmp_path / "fleet" / "store-1") as kb:
        rows = {str(r.value("robot")): r for r in kb.select(ATTEMPTS)}
        assert {name: int(r.value("n")) for name, r in rows.items()} == reported
        assert all(int(r.value("graphs")) == 1 for r in rows.values())
    figures = fleet_figures(done, fleet.plan)
    assert figures["robots"][0]["tried"] <= 2
    assert {len(row) for row in fleet_rows(figures)} == {len(COLUMNS)}
    write_fleet_report(tmp_path / "report", [("shared", done, figures)])
    assert (tmp_path / "report" / "report.json").exists()


def test_half_of_what_a_robot_meets_is_met_by_all_and_the_other_half_by_it_alone() -> None:
    plan = plan_fleet(3, 20, 4, seed=1)
    tables = [plan.tables(robot) for robot in range(3)]
    assert [len(table) for table in tables[0]] == [4] * 5
    met = [{name for table in one for name in table} for one in tables]
    assert [len(one) for one in met] == [20, 20, 20]
    assert len(met[0] & met[1] & met[2]) == 10
    assert (met[0] & met[1]) == (met[1] & met[2])
    assert plan == plan_fleet(3, 20, 4, seed=1) != plan_fleet(3, 20, 4, seed=2)


@pytest.mark.parametrize(
    ("asked", "said"),
    [((0, 4, 2, 1), "--robots"), ((2, 5, 2, 1), "--objects"), ((2, 6, 3, 1), "--table")],
)
def test_a_fleet_that_does_not_fit_is_refused_by_name(asked: Any, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        plan_fleet(*asked)


def test_a_folder_with_other_things_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(UsageError, match="not a fleet's folder"):
        Fleet(FleetSettings(tmp_path)).run()
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def _met(product: str, tries: int | None, source: str = "candidate", **more: Any) -> dict[str, Any]:
    attempts = [{"source": source}] * (tries or 6)
    return {
        "product": product, "in_reach": True, "tries": tries or 6, "tries_to_success": tries,
        "held": tries is not None, "placed": True, "right": None, "recognised": "",
        "object_iri": f"o:{product}", "attempts": attempts, **more,
    }  # fmt: skip


def test_the_last_robot_is_compared_with_the_first_on_what_both_met() -> None:
    plan = plan_fleet(2, 2, 2, seed=1)
    ((common,),) = plan.common
    own = [plan.own[robot][0][0] for robot in range(2)]
    done = {
        "settings": {"max_attempts": 6, "sharing": True},
        "robots": [
            {"name": "robot-1", "lost": "", "undelivered": 0,
             "tables": [[_met(common, 3), _met(own[0], None)]]},
            {"name": "robot-2", "lost": "", "undelivered": 0,
             "tables": [[_met(common, 1, "memory", recognised=f"o:{common}"),
                         _met(own[1], 2, recognised=f"o:{common}")]]},
        ],
    }  # fmt: skip
    figures = fleet_figures(done, plan)
    first, last = figures["robots"]
    assert (first["attempts"]["mean"], last["attempts"]["mean"]) == (5.0, 1.5)
    assert (first["attempts_own"]["mean"], last["attempts_own"]["mean"]) == (7.0, 2.0)
    assert (last["recognised"], last["false_identities"], last["from_memory"]) == (1, 1, 1)
    assert figures["last_less_first"]["attempts"] == -2.0
    assert figures["last_less_first"]["products"] == 1
    alone = {**done, "robots": [done["robots"][0]] * 2}  # the last one learned from nobody
    assert sharing_gain(done, alone, plan)["attempts"] == 1 - 3
