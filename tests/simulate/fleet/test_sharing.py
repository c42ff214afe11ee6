"""The study of sharing: who shares a graph with whom, and what is compared with what."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rtask.errors import UsageError
from simulate.fleet import sharing
from simulate.fleet.headroom import headroom_won
from simulate.fleet.sharing import (
    COLUMNS,
    sharing_rows,
    sharing_study,
    sharing_trial,
    summarise_sharing,
)

NOTE = "INSERT DATA { GRAPH <%s> { <urn:%s> a <urn:Robot> } }"
NOTED = "SELECT DISTINCT ?robot { GRAPH ?g { ?robot a <urn:Robot> } } ORDER BY ?robot"


def _met(product: str, tries: int | None, recognised: str = "") -> dict[str, Any]:
    return {
        "product": product, "in_reach": True, "tries": tries or 6, "tries_to_success": tries,
        "held": tries is not None, "placed": True, "right": None, "recognised": recognised,
        "object_iri": f"o:{product}", "attempts": [],
    }  # fmt: skip


class _Notes:
    """A robot that writes its name into the graph instead of grasping, and reads who was there."""

    met: list[tuple[str, int, list[str]]] = []  # noqa: RUF012 - emptied by the test

    def __init__(self, job: Any, client: Any, tell: Any, assets: Path) -> None:
        self.job, self.client = job, client

    def clear(self, number: int) -> list[dict[str, Any]]:
        there = [row["robot"].removeprefix("urn:") for row in self.client.query(NOTED)]
        self.met.append((self.job.name, number, there))
        graph = self.client.engine.kb.graphs.agent(self.job.name).value
        self.client.update(NOTE % (graph, self.job.name))
        return [_met(name, 1) for name in self.job.tables[number]]


@pytest.mark.slow
def test_one_after_the_other_in_one_graph_then_each_in_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sharing, "Member", _Notes)
    monkeypatch.setattr(_Notes, "met", [])
    study = sharing_study(1, 3, 4, 2, seed=5, prior=False, preset="fast")
    result = sharing_trial(study.settings, 0)
    first, second, third = "robot-1", "robot-2", "robot-3"
    assert _Notes.met == [
        (first, 0, []), (first, 1, [first]),
        (second, 0, [first]), (second, 1, [first, second]),
        (third, 0, [first, second]), (third, 1, [first, second, third]),
        (second, 0, []), (second, 1, [second]),
        (third, 0, []), (third, 1, [third]),
    ]  # fmt: skip
    assert result["shared"] == result["not shared"]  # the same products on the same tables
    assert len(result["common"]) == 2
    assert json.dumps(result) == json.dumps(sharing_trial(study.settings, 0))
    assert result["common"] != sharing_trial(study.settings, 1)["common"]


def test_a_fleet_that_does_not_fit_is_refused_before_it_begins() -> None:
    with pytest.raises(UsageError, match="--objects"):
        sharing_study(1, 3, 5, 2, seed=5, prior=False, preset="fast")


@pytest.mark.slow
def test_look_alikes_are_met_by_all_robots_but_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    met: list[tuple[str, bool]] = []

    class Recorder(_Notes):
        def clear(self, number: int) -> list[dict[str, Any]]:
            met.append((self.job.name, self.job.look_alikes))
            return [_met(name, 1) for name in self.job.tables[number]]

    monkeypatch.setattr(sharing, "Member", Recorder)
    study = sharing_study(
        1, 2, 2, 2, seed=5, prior=False, preset="fast", products="hard", look_alikes=True
    )
    sharing_trial(study.settings, 0)
    assert met == [("robot-1", False), ("robot-2", True), ("robot-2", True)]


def test_plain_products_have_no_look_alikes() -> None:
    with pytest.raises(UsageError, match="--products hard"):
        sharing_study(1, 2, 2, 2, seed=5, prior=False, preset="fast", look_alikes=True)


def _fleet(shared: int, alone: int) -> dict[str, Any]:
    """One common and one own product a robot; the others take so many tries at the common one."""

    def robot(number: int, tries: int, recognised: str = "") -> dict[str, Any]:
        met = [_met("can-1", tries, recognised), _met(f"pen-{number}", 2)]
        return {"name": f"robot-{number}", "tables": [met]}

    first = robot(1, 4)
    return {
        "common": ["can-1"],
        "shared": [first, robot(2, shared, "o:can-1"), robot(3, shared, "o:pen-1")],
        "not shared": [first, robot(2, alone), robot(3, alone)],
    }


@pytest.mark.slow
def test_shared_is_compared_with_not_shared_robot_by_robot_and_product_by_product(
    tmp_path: Path,
) -> None:
    results = [_fleet(1, 3), _fleet(2, 2), _fleet(1, 2)]
    summary = summarise_sharing(results, max_attempts=6)
    gain = summary["shared_less_not_shared"]
    assert gain["common"]["attempts"]["mean"] == pytest.approx(-1.0)
    assert gain["common"]["attempts"]["n"] == 6  # two robots of three fleets
    assert gain["common"]["attempts"]["products"] == 3
    assert gain["common"]["first_try"]["mean"] == pytest.approx(2 / 3, abs=1e-4)
    assert gain["own"]["attempts"]["interval95"] == [0.0, 0.0]
    assert summary["last_less_first"]["shared"]["mean"] == pytest.approx(-8 / 3, abs=1e-4)
    assert summary["last_less_first"]["not shared"]["mean"] == pytest.approx(-5 / 3, abs=1e-4)
    row = summary["robots"][1]
    assert (row["graph"], row["robot"], row["recognised"]) == ("shared", 2, 3)
    assert summary["robots"][2]["false_identities"] == 3  # it took a can for a pen
    assert {len(row) for row in sharing_rows(summary)} == {len(COLUMNS)}
    study = sharing_study(3, 3, 4, 2, seed=5, prior=False, preset="fast")
    report = study.describe(results, study.settings, tmp_path)
    assert report.figures["robots"] == summary["robots"]
    assert "shared less not shared, common, attempts: -1.00" in report.lines[0]
    assert (tmp_path / "sharing.png").read_bytes().startswith(b"\x89PNG")


def _pair(tries: dict[str, list[int | None]]) -> dict[str, Any]:
    """Return a fleet of two robots: attempts at each product by the first, the second with the
    graph, and without.
    """
    lives = [
        {"name": name, "tables": [[_met(product, took[i]) for product, took in tries.items()]]}
        for i, name in enumerate(("robot-1", "robot-2", "robot-2"))
    ]
    return {"common": list(tries), "shared": lives[:2], "not shared": [lives[0], lives[2]]}


def test_headroom_lies_between_first_tries_of_robot_1_and_what_any_robot_can_hold() -> None:
    fleet = _pair(
        {"bar-1": [1, 1, 1], "bar-2": [3, 1, 2], "bar-3": [2, 1, 1], "bar-4": [None, 2, None],
         "bar-5": [None, None, None]}
    )  # fmt: skip
    shared = headroom_won([fleet, fleet], "shared")
    assert (shared["n"], shared["first_try"], shared["best"]) == (10, [0.2, 0.6], 0.8)
    assert shared["won"] == pytest.approx(2 / 3, abs=1e-4)  # bar-5 holds nowhere
    assert headroom_won([fleet], "not shared")["won"] == pytest.approx(1 / 3, abs=1e-4)
    assert headroom_won([_pair({"can-1": [1, 1, 1]})], "shared")["won"] is None
    assert headroom_won([], "shared")["n"] == 0


def test_the_share_of_the_headroom_has_an_interval_where_enough_products_leave_any() -> None:
    fleet = _pair({"bar-1": [1, 1, 1], "bar-2": [3, 1, 2]})
    assert headroom_won([fleet] * 3, "shared")["won"] == 1.0
    assert headroom_won([fleet] * 3, "shared")["interval95"] is None
    assert headroom_won([fleet] * 8, "shared")["interval95"] == [1.0, 1.0]
    low, high = headroom_won([fleet] * 8, "not shared")["interval95"]
    assert -1.0 <= low <= high <= 1.0
