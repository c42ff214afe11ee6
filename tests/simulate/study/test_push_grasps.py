"""An arm carries out push grasps of a part that it imaged, and the report counts what was true."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from grasp.push.polygon import triangles
from simulate.grasping.executor import Workcell
from simulate.grasping.push_grasping import ArmPush, plan_arm_push
from simulate.studies import study
from simulate.study.pushes.plug import ARM, PUBLISHED, chosen, plug, printed
from simulate.study.pushes.report import push_rows, summarise_pushes
from simulate.study.pushes.trial import carry_out, lies_flat, planned, push_trial

pytestmark = pytest.mark.slow

SETTINGS = {"seed": 0, "preset": "fast", "trials": 1, "prints": 1}


def test_the_contour_of_the_image_is_the_plug():
    plan, pixels, _, _ = planned(0, "fast")
    ring = plug().ring
    assert pixels.shape == (480, 640, 3)
    # A pixel is .27 mm on the part, and the contour may be off by half a deviation, .6 mm.
    for corner in ring:
        assert np.linalg.norm(plan.part.vertices - corner, axis=1).min() < 0.001
    area = sum(
        float(np.linalg.det(np.column_stack([t[1] - t[0], t[2] - t[0]])) / 2)
        for t in triangles(plan.part.vertices)
    )
    true = sum(
        float(np.linalg.det(np.column_stack([t[1] - t[0], t[2] - t[0]])) / 2)
        for t in triangles(ring)
    )
    assert area == pytest.approx(true, rel=0.05)


def test_the_best_grasp_and_two_lesser_ones_are_carried_out():
    plan, _, jaw, stroke = planned(0, "fast")
    quality = plan.analysis.quality[chosen(plan, jaw, stroke)]
    assert quality[0] > quality[1] > quality[2]
    assert quality[1:] == pytest.approx([q / 100 for q, _ in PUBLISHED[1:]], abs=0.05)


def test_a_push_turns_a_part_flat_and_lifts_it_where_the_hand_is_and_no_other_place():
    # The plug's long side faces the jaw at 8 degrees, well inside the friction cone.
    part = plug()
    along = np.array([np.cos(0.5 + np.pi / 2 + 0.14), np.sin(0.5 + np.pi / 2 + 0.14)])
    start = part.com + (0.04 - 0.013 - 0.012) * along
    with Workcell("panda", "fast") as cell:
        found = carry_out(cell, part, ArmPush(start, along, 0.05, 0.025), 1)
    assert found["held"]
    assert found["flat"]
    assert found["turned_deg"] == pytest.approx(np.degrees(0.14), abs=2.5)  # .3 mm in 10
    with Workcell("panda", "fast") as cell:
        missed = carry_out(
            cell, part, ArmPush(start + np.array([0.0, 0.12]), along, 0.05, 0.025), 1
        )
    assert not missed["held"]
    assert missed["reason"] == "missed"


def test_a_place_out_of_reach_is_a_reason_and_no_motion():
    with Workcell("panda", "fast") as cell:
        push = ArmPush(np.array([1.4, 0.0]), np.array([1.0, 0.0]), 0.05, 0.025)
        assert plan_arm_push(cell.executor, ARM, push) == "ik"


def test_flat_means_an_edge_or_two_corners_on_the_jaw():
    up, middle = np.array([0.0, 1.0]), np.array([0.01, 0.0])
    tooth = np.array([(0, 0), (0.008, 0.004), (0.016, 0), (0.016, 0.02), (0, 0.02)], dtype=float)
    assert lies_flat(tooth, up, middle, 0.02)
    assert not lies_flat(tooth, up, middle + np.array([0.015, 0.0]), 0.02)
    assert not lies_flat(tooth, up, middle + np.array([1.0, 0.0]), 0.02)


def test_printed_parts_come_from_the_distribution_that_was_planned_for():
    plan, _, jaw, _ = planned(0, "fast")
    made = [part for k in range(200) if (part := printed(plan, jaw, k, 0)) is not None]
    off = np.array([part.ring - plan.part.vertices for part in made])
    # 200 draws of 12 vertices and two axes: the deviation's own error is 1 %.
    assert off.std() == pytest.approx(plan.tolerance.vertex_std, rel=0.05)
    assert abs(off.mean()) < 0.05 * plan.tolerance.vertex_std
    again = printed(plan, jaw, 0, 0)
    assert np.array_equal(again.ring, made[0].ring)


def test_trials_repeat_and_the_report_counts_them():
    results = [push_trial(SETTINGS, number) for number in range(2)]
    assert results[1] == push_trial(SETTINGS, 1)
    assert [r["printed"] for r in results] == [False, True]
    made = [
        {"grasp": g, "printed": p, "held": h, "flat": False, "reason": "ok"}
        for g in range(3)
        for p, h in ((False, True), (True, False))
    ]
    summary = summarise_pushes(made, 0, "fast")
    assert summary["grasps"][0]["plug"]["held"]["hits"] == 1
    assert summary["grasps"][0]["printed"]["held"]["hits"] == 0
    assert push_rows(summary)[2][1:3] == ("23.3", "0 of 5")


def test_the_command_writes_report_and_picture(tmp_path):
    out = tmp_path / "out"
    words = ["push-grasps", "-n", "1", "--prints", "0", "--preset", "fast", "--workers", "1"]
    done = CliRunner().invoke(study, [*words, "--out", str(out), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout[done.stdout.index("{") :])
    assert [g["plug"]["held"]["n"] for g in told["grasps"]] == [1, 1, 1]
    assert cv2.imread(str(out / "grasps.png")).shape == (600, 1800, 3)
    assert json.loads((out / "report.json").read_text())["grasps"] == told["grasps"]
    refused = CliRunner().invoke(study, ["push-grasps", "-n", "0"])
    assert refused.exit_code == 2
    assert "at least 1" in refused.output
