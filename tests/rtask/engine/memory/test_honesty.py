"""Robots that report falsely are found out; robots with little or odd luck are not suspected."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from rtask.cli import cli
from rtask.engine.honesty import MANNERS, Reports, judge_honesty

GRASP = {"in_object": {"x": 0.01, "y": 0.0, "z": 0.03, "theta": 1.57}, "quality": 0.6,
         "opening": 0.04}  # fmt: skip


def fleet(seed: int, lie: str, reports: int, liars: int = 2) -> list[Reports]:
    """Return what ten robots report of 40 grasps whose chances are mostly high or low."""
    rng = np.random.default_rng(seed)
    chances = rng.beta(0.6, 0.6, 40)
    true, false = MANNERS[lie]
    said = []
    for robot in range(10):
        for grasp in rng.integers(40, size=reports).tolist():
            held = rng.random() < chances[grasp]
            if robot < liars:
                held = rng.random() < (true if held else false)
            said.append(Reports(f"r{robot}", f"g{grasp}", int(held), 1))
    return said


@pytest.mark.parametrize("lie", ["the other way round", "always held", "never held"])
def test_liars_are_named_by_fifty_reports_and_nobody_else_is(lie: str) -> None:
    named = mistaken = 0
    for seed in range(10):
        found = judge_honesty(fleet(seed, lie, 50))
        named += sum(found[f"r{k}"].contradicts for k in range(2))
        mistaken += sum(found[f"r{k}"].contradicts for k in range(2, 10))
        assert {found[f"r{k}"].manner for k in range(2)} == {lie}
    assert named == 20  # of 20; fixed seeds, so no tolerance
    assert mistaken == 0  # of 80


def test_where_all_are_truthful_nobody_is_named() -> None:
    for seed in range(10):
        found = judge_honesty(fleet(seed, "truthful", 50))
        assert not any(one.contradicts for one in found.values())
        assert min(one.truthful for one in found.values()) > 0.5


@pytest.mark.parametrize("kept", [0.8, 0.7])
def test_a_worn_hand_that_tells_the_truth_is_believed(kept: float) -> None:
    weights = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        said = []
        for one in fleet(seed, "truthful", 50):
            is_lost = one.robot in ("r0", "r1") and rng.random() >= kept
            said.append(replace(one, held=0) if is_lost else one)
        found = judge_honesty(said)
        assert not any(one.contradicts for one in found.values())
        weights += [found[name].weight for name in ("r0", "r1")]
    assert np.mean(weights) > 0.95


def test_who_cannot_be_compared_is_not_doubted() -> None:
    said = [Reports("r0", f"g{k}", 0, 5) for k in range(20)]
    said += [Reports("r1", f"h{k}", 5, 5) for k in range(20)]
    found = judge_honesty(said)
    assert [one.comparable for one in found.values()] == [0, 0]
    assert not any(one.contradicts for one in found.values())
    assert judge_honesty([]) == {}


def test_thousands_of_attempts_at_one_grasp_are_weighed() -> None:
    said = [Reports(f"r{k}", f"g{i}", 10_000 + 10 * k, 20_000) for k in range(3) for i in range(2)]
    said += [Reports("liar", f"g{i}", 0, 20_000) for i in range(2)]
    found = judge_honesty(said)
    assert [name for name, one in found.items() if one.contradicts] == ["liar"]
    assert all(np.isfinite(one.truthful) for one in found.values())


def test_the_order_of_reports_and_their_grouping_make_no_difference() -> None:
    said = fleet(3, "the other way round", 30)
    doubled = [Reports(one.robot, one.grasp, one.held, one.count) for one in reversed(said)]
    one, other = judge_honesty(said), judge_honesty(doubled)
    for name in one:
        assert one[name].truthful == pytest.approx(other[name].truthful, abs=1e-9)


def told(robot, thing, held, outcome, number):
    grasp = {**GRASP, "in_object": {**GRASP["in_object"], "x": 0.004 * number}}
    robot.call(
        "report_outcome", object=thing, gripper_id=robot.gripper, grasp=grasp,
        outcome=outcome(held),
    )  # fmt: skip


def test_choices_leave_out_the_reports_of_a_liar(bench, engine, robots):
    fair = [robots(f"nao-{k}") for k in range(3)]
    liar = robots("liar")
    thing = fair[0].insert(bench.sight(bench.BOX))["objects"][0]["object"]

    def outcome(held):
        return bench.held() if held else bench.missed()

    for number in range(4):
        for robot in (*fair, liar):
            for _ in range(3):
                truth = number % 2 == 0
                told(robot, thing, truth != (robot is liar), outcome, number)
    rows = engine.call("compare_contributors", {}).as_json()["contributors"]
    first = rows[0]
    assert (first["name"], first["finding"]) == ("liar", "contradicts")
    assert first["manner"] == "the other way round"
    assert (first["agreement"], first["comparable"], first["attempts"]) == (0.0, 12, 12)
    assert first["interval95"][1] < 0.3
    assert [row["finding"] for row in rows[1:]] == ["agrees"] * 3
    answer = fair[0].recognise(bench.sight(bench.BOX))
    counted = {
        (grasp["statistics"]["successes"], grasp["statistics"]["attempts"])
        for grasp in answer["grasps"]
        if grasp["source"] == "memory"
    }
    assert counted == {(9, 9), (0, 9)}
    (only,) = engine.call("compare_contributors", {"contributor": "nao-1"}).as_json()[
        "contributors"
    ]
    assert only["name"] == "nao-1"


def test_the_shell_lists_and_withdraws_contributors(bench, tmp_path):
    import rtask
    from rtask.engine import Engine

    data = str(tmp_path / "store")
    with rtask.open(data, reason=False) as kb, Engine(kb) as engine:
        robot = bench.Robot("nao-1", engine)
        robot.register()
        thing = robot.insert(bench.sight(bench.BOX))["objects"][0]["object"]
        told(robot, thing, True, lambda held: bench.held(), 0)
    shell = CliRunner()
    listed = shell.invoke(cli, ["contributors", "list", "-d", data])
    assert listed.exit_code == 0, listed.output
    assert "nobody else has tried" in listed.output
    as_json = shell.invoke(cli, ["contributors", "list", "-d", data, "--json"])
    assert [one["name"] for one in json.loads(as_json.stdout)] == ["nao-1"]
    assert shell.invoke(cli, ["contributors", "list", "nobody", "-d", data]).exit_code == 1
    gone = shell.invoke(cli, ["contributors", "withdraw", "nao-1", "--agent", "ann", "-d", data])
    assert gone.exit_code == 0, gone.output
    assert "1 attempts, 0 verdicts and 1 objects" in gone.output
    commit = gone.output.split(":")[0]
    undone = shell.invoke(cli, ["objects", "undo", commit, "--agent", "ann", "-d", data])
    assert undone.exit_code == 0, undone.output
    assert shell.invoke(cli, ["contributors", "list", "-d", data]).exit_code == 0


def test_reports_of_a_robot_in_doubt_weigh_less_and_the_explanation_says_so(bench, engine, robots):
    fair = [robots(f"nao-{k}") for k in range(3)]
    odd = robots("odd")
    thing = fair[0].insert(bench.sight(bench.BOX))["objects"][0]["object"]

    def outcome(held):
        return bench.held() if held else bench.missed()

    for robot in fair:
        for _ in range(3):
            told(robot, thing, True, outcome, 0)
    told(odd, thing, False, outcome, 0)
    rows = engine.call("compare_contributors", {}).as_json()["contributors"]
    weights = {row["name"]: row["weight"] for row in rows}
    assert (rows[0]["name"], rows[0]["finding"]) == ("odd", "agrees")
    assert 0.2 < weights["odd"] < 0.8  # one report against nine: not named, but it counts for less
    assert f"counts {weights['odd']:.2f} for others" in rows[0]["text"]
    assert {weights[robot.name] for robot in fair} == {1.0}

    def remembered(robot):
        answer = robot.recognise(bench.sight(bench.BOX), object=thing)
        (only,) = (grasp for grasp in answer["grasps"] if grasp["source"] == "memory")
        return only["statistics"], only["explanation"]

    counts, why = remembered(fair[0])
    assert (counts["successes"], counts["attempts"]) == (9, 10)  # what is stored stays
    (doubted,) = why["doubted"]
    assert doubted["robot"].endswith("/odd")
    assert (doubted["attempts"], doubted["held"], doubted["weight"]) == (1, 0, weights["odd"])
    assert f"from odd count {weights['odd']:.2f} each" in why["text"]
    won, lost = why["graph"]
    assert lost / won == pytest.approx(2 * weights["odd"] / 9, rel=1e-4)
    _, own = remembered(odd)
    assert "doubted" not in own  # a robot takes its own word


def test_who_has_not_been_compared_counts_in_full() -> None:
    found = judge_honesty([Reports("r0", "g0", 1, 1), Reports("r1", "g1", 0, 30)])
    assert [one.weight for one in found.values()] == [1.0, 1.0]


def test_a_report_counts_for_less_the_more_it_contradicts() -> None:
    weights = []
    for lies in range(4):
        said = [Reports(f"r{k}", f"g{i}", 4, 4) for k in range(3) for i in range(3)]
        said += [Reports("odd", f"g{i}", int(i >= lies), 1) for i in range(3)]
        weights.append(judge_honesty(said)["odd"].weight)
    assert weights == sorted(weights, reverse=True)
    assert weights[0] == 1.0
    assert weights[3] < 0.6
