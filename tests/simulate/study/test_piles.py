"""Piles touch, the arm picks from them, and the report counts what was true."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from grasp.spatial.candidate import GraspCandidate, Proposals
from rtask.cli import main
from rtask.engine.perception.clutter import ClutterView
from rtask.errors import UsageError
from simulate.grasping import clearing
from simulate.grasping.clutter import look_at_clutter, pick_from
from simulate.grasping.pushing import plan_push
from simulate.study.clutter.report import clutter_rows, summarise_piles, summarise_tables
from simulate.study.clutter.trial import ARM, clear_trial, laid_table, pile_trial

PILE = {"seed": 3, "objects": 4, "preset": "fast"}


@pytest.mark.slow
def test_a_pile_touches_and_lies_on_the_table():
    with laid_table({**PILE, "seed": 5, "objects": 5}, 0) as table:
        world = table.cell.world
        assert table.touching >= 2
        for body in table.contents:
            pose = world.object_pose(body)
            assert pose.z > world.table_height
            assert abs(pose.x - 0.46) < 0.2
            assert abs(pose.y) < 0.2
        view = look_at_clutter(table.cell.executor)
        assert len(view.segments) >= 2
        assert view.table_height == pytest.approx(world.table_height, abs=0.004)


@pytest.mark.slow
def test_a_naos_products_touch_before_each_hand():
    with laid_table({**PILE, "robot": "nao", "objects": 6}, 0) as table:
        world = table.cell.world
        at = [world.object_pose(body) for body in table.contents]
        assert sum(pose.y > 0.03 for pose in at) == sum(pose.y < -0.03 for pose in at) == 3
        assert all(world.table_height < pose.z < world.table_height + 0.1 for pose in at)
        for body in table.contents:
            others = [other for other in table.contents if other != body]
            assert any(world.client.getClosestPoints(body, other, 0.002) for other in others)


@pytest.mark.slow
@pytest.mark.deep
def test_a_nao_clears_by_its_agent_and_says_why_it_left_what_is_left():
    result = clear_trial(
        {"seed": 3, "objects": 2, "preset": "fast", "robot": "nao", "agent": True}, 0
    )
    assert result["cleared"] + len(result["left"]) == 2
    assert len(result["why_left"]) == len(result["left"])
    assert all(result["why_left"])
    assert result["picks"] >= 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--robot", "nao", "--clear"), "--with-agent"),
        (("--robot", "panda", "--clear", "--with-agent"), "no full poses"),
        (("--robot", "nao", "--clear", "--with-agent", "--hand", "suction:0.01"), "--hand"),
    ],
)
def test_what_only_a_panda_does_is_refused(options, said, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["study", "piles", *options])
    assert caught.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.deep
def test_a_pick_lifts_one_thing_and_is_the_same_every_time():
    first = pile_trial(PILE, 0)
    assert first["lifted"]
    assert first["reason"] == "ok"
    assert pile_trial(PILE, 0) == first


@pytest.mark.slow
@pytest.mark.parametrize("objects", [1, pytest.param(2, marks=pytest.mark.deep)])
def test_a_table_is_cleared_and_truth_agrees(objects):
    result = clear_trial({"seed": 3, "objects": objects, "preset": "fast"}, 1)
    assert result["cleared"] == objects
    assert result["left"] == []
    assert sum(move["lifted"] for move in result["moves"]) >= objects


@pytest.mark.slow
def test_a_push_moves_the_thing():
    with laid_table({"seed": 3, "objects": 1, "preset": "fast"}, 2) as table:
        executor, (body,) = table.cell.executor, table.contents
        view = look_at_clutter(executor)
        before = table.cell.world.object_pose(body).position
        plan = plan_push(view, int(view.labels.max()), executor, ARM)
        run = executor.begin(plan)
        assert run.pretend() == "ok"
        run.put_back()
        moved = table.cell.world.object_pose(body).position - before
        assert np.linalg.norm(moved[:2]) > 0.02


def test_a_push_that_did_not_arrive_says_why(monkeypatch):
    points = np.zeros((50, 3))
    view = ClutterView(
        points, np.ones(50, np.int32), np.arange(50), np.ones(3), np.array([0, 0, 1.0, 0]), 0.0
    )
    nothing = Proposals(reason="no hand closes on a single object")
    for name, value in (
        ("hand_of", None), ("look_at_clutter", view), ("plan_in_view", nothing),
        ("pick_from", (None, ("ik", "grasp_collision"))), ("plan_push", "a plan"),
    ):  # fmt: skip
        monkeypatch.setattr(clearing, name, lambda *args, value=value: value)
    run = SimpleNamespace(pretend=lambda: "tracking")
    executor = SimpleNamespace(robot=SimpleNamespace(description=None), begin=lambda plan: run)
    moves = list(clearing.clear_clutter(executor, "arm"))
    assert [(move.kind, move.reason) for move in moves] == [
        *[("push", "tracking")] * 4, ("none", nothing.reason)
    ]  # fmt: skip
    (only,) = clearing.clear_clutter(executor, "arm", pushes=False)
    assert (only.kind, only.reason) == ("none", nothing.reason)
    assert {move.refused for move in [*moves, only]} == {("ik", "grasp_collision")}


def test_why_the_arm_refuses_grasps_is_told_with_a_pick_and_without_one():
    points = np.random.default_rng(0).uniform(0.0, 0.03, (60, 3))
    view = ClutterView(
        points, np.ones(60, np.int32), np.arange(60), np.ones(3), np.array([0, 0, 1.0, 0]), 0.0
    )
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    grasps = [GraspCandidate(down, 0.03, opening=0.05, segment=1) for _ in range(4)]

    def asked(*answers):
        left = iter(answers)
        executor = SimpleNamespace(plan=lambda request, obstacles, seed: next(left))
        return pick_from(view, Proposals(tuple(grasps)), executor, "arm", tries=3)

    assert asked("ik", "grasp_collision", "ik") == (None, ("ik", "grasp_collision", "ik"))
    plan = object()
    pick, refused = asked("ik", plan)
    assert (pick.plan, pick.candidate, pick.rank, refused) == (plan, grasps[1], 1, ("ik",))


def a_pile(lifted, reason, **more):
    return {"touching": 3, "lifted": lifted, "reason": reason, "placed": lifted, "moved": 0,
            "refused": [], **more}  # fmt: skip


def test_a_pile_without_a_pick_counts_as_missed():
    summary = summarise_piles([a_pile(True, "ok"), a_pile(False, "out_of_reach")])
    first = summary["shares"]["first pick lifts"]
    assert (first["hits"], first["n"]) == (1, 2)
    assert summary["reasons"] == {"ok": 1, "out_of_reach": 1}
    assert clutter_rows(summary)[0][:3] == ("first pick lifts", "0.500", "1 of 2")


def test_tables_are_resampled_whole():
    pick = {"kind": "pick", "reason": "ok", "lifted": True}
    tables = [
        {"objects": 10, "cleared": c, "touching": 1, "moves": [pick], "off_table": 0, "pushes": 1}
        for c in (10, 10, 4)
    ]
    shares = summarise_tables(tables)["shares"]
    assert shares["things cleared"]["share"] == pytest.approx(0.8)
    low, high = shares["things cleared"]["interval95"]
    assert low == pytest.approx(0.4)
    assert high == 1.0
    assert shares["tables wholly cleared"]["hits"] == 2


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--hand", "foo"], "gripper 'foo': the panda takes suction:RADIUS"),
        (["--hand", "suction:nan"], "gripper 'suction:nan': expected a radius in m"),
        (["--hand", "missing.toml"], "gripper 'missing.toml': No such file"),
        (["--seed", "-1"], "-1 is not in the range"),
        (["--out", "/proc/none"], "/proc/none: No such file or directory"),
    ],
)
def test_wrong_options_are_one_line_before_anything_is_made(args, words, tmp_path, capsys):
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stopped:
        main(["study", "piles", "-n", "1", "--out", str(out), *args])
    assert stopped.value.code in (2, 3)
    said = capsys.readouterr().err.strip().splitlines()
    assert words in said[-1]
    assert sum(not line.startswith(("Usage:", "Try", "\n")) for line in said if line) == 1
    assert not out.exists()


@pytest.mark.parametrize(("words", "part"), [((), ""), (("--pictures",), "piles")])
def test_views_of_piles_are_drawn_beside_the_figures_if_asked(words, part, tmp_path, monkeypatch):
    asked = []

    def study(trials, objects, seed, preset, pictures, hand):
        asked.append(pictures)
        raise UsageError("enough")

    monkeypatch.setattr("simulate.study.clutter.report.pile_study", study)
    with pytest.raises(SystemExit):
        main(["study", "piles", "-n", "1", "--out", str(tmp_path / "out"), *words])
    assert asked == [str(tmp_path / "out" / part) if part else ""]
