"""The comparison of planned grasps with a trivial sampler's."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial import ConvexHull

from grasp.spatial.gripper import nao_hand, panda_hand
from grasp.spatial.scoring.promises import FactoryMap
from rtask.errors import UsageError
from simulate.study.quality.bench import draws, laid_out
from simulate.study.quality.command import grasp_quality
from simulate.study.quality.objects import FAMILIES, GraspObject, fits, generated
from simulate.study.quality.promised import coverage_of
from simulate.study.quality.public_models import public_model, ycb_models
from simulate.study.quality.ranks import rank_correlations
from simulate.study.quality.report import quality_rows, summarise_quality
from simulate.study.quality.sampler import sampled_grasp
from simulate.study.quality.trial import RULES, quality_trial
from simulate.study.quality.tried_fit import fit_tried
from simulate.study.quality.varied_objects import VARIED, varied

HAND = panda_hand()


@pytest.mark.parametrize("number", range(len(FAMILIES)), ids=FAMILIES)
def test_a_generated_object_is_centred_and_suits_its_hand(number: int) -> None:
    thing, again = generated(3, number, HAND), generated(3, number, HAND)
    assert thing.name == f"{FAMILIES[number]}-{number}"
    assert all(np.array_equal(a, b) for a, b in zip(thing.parts, again.parts, strict=True))
    mesh = thing.mesh()
    assert np.allclose(mesh.com, 0.0, atol=1e-6)
    # 20 N at friction .5 bear 2.04 kg.
    assert 0.2 < thing.mass < 1.02
    small = generated(3, number, nao_hand())
    assert np.allclose(np.ptp(small.mesh().vertices, axis=0),
                       np.ptp(mesh.vertices, axis=0) * 5 / 8)  # fmt: skip
    assert small.mass == pytest.approx(thing.mass / 10)


@pytest.mark.parametrize("number", range(2 * len(VARIED)), ids=VARIED * 2)
def test_an_object_of_the_wider_family_is_sound(number: int) -> None:
    thing, again = varied(3, number, HAND), varied(3, number, HAND)
    assert thing.name == f"{VARIED[number % len(VARIED)]}-{number}"
    assert all(np.array_equal(a, b) for a, b in zip(thing.parts, again.parts, strict=True))
    mesh = thing.mesh()
    assert np.allclose(mesh.com, 0.0, atol=1e-6)
    assert 0.006 <= thing.mass <= 0.9 * 2.04
    # Turned any way, nothing is longer than its diagonal.
    assert np.ptp(mesh.vertices, axis=0).max() <= 4 * HAND.max_opening * np.sqrt(3)
    # What is thinner than a millimetre, the physics may lose.
    assert all(ConvexHull(part).volume > 0 for part in thing.parts)


def _box() -> GraspObject:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return GraspObject("box", (corners * (0.02, 0.03, 0.04),), 0.2)


def test_parts_are_written_for_the_physics(tmp_path: Path) -> None:
    (path,) = _box().write(tmp_path)
    lines = path.read_text().splitlines()
    assert sum(line.startswith("v ") for line in lines) == 8
    assert sum(line.startswith("f ") for line in lines) == 12


def test_a_hand_takes_what_is_narrow_and_light() -> None:
    assert fits(_box(), HAND)
    assert not fits(GraspObject("lead", _box().parts, 1.5), HAND)
    assert not fits(GraspObject("crate", (_box().parts[0] * 5,), 0.2), HAND)


def test_a_folder_without_models_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="coacd"):
        ycb_models(tmp_path)


def test_the_sampler_takes_a_box_across_from_above() -> None:
    mesh = _box().mesh()
    standing = mesh.vertices + np.array([0, 0, 0.04])
    found = sampled_grasp(standing, mesh.faces, np.array([0, 0, 0.04]), HAND, 0.0, 1)
    assert found is not None
    assert found.opening == HAND.max_opening
    assert found.approach[2] == pytest.approx(-1.0, abs=1e-6)
    assert found.width == pytest.approx(0.04) or found.width == pytest.approx(0.06)
    assert np.linalg.norm(found.centre - (0, 0, 0.04)) < 0.01


def test_the_sampler_finds_nothing_on_what_is_too_wide() -> None:
    mesh = GraspObject("crate", (_box().parts[0] * 5,), 1.0).mesh()
    standing = mesh.vertices + np.array([0, 0, 0.2])
    assert sampled_grasp(standing, mesh.faces, np.array([0, 0, 0.2]), HAND, 0.0, 1) is None


def test_draws_are_the_same_for_all_grasps_of_an_object_and_differ_between_objects() -> None:
    first, again, other = draws(1, 2, 3, 0.1), draws(1, 2, 3, 0.1), draws(1, 3, 3, 0.1)
    for a, b, c in zip(first, again, other, strict=True):
        assert np.array_equal(a.error, b.error)
        assert a.conditions == b.conditions
        assert not np.array_equal(a.error, c.error)
        assert 0.35 <= a.conditions.friction <= 0.8
        assert a.conditions.shake


@pytest.mark.slow
def test_a_good_grasp_of_a_box_is_carried_and_one_beside_it_is_not() -> None:
    with laid_out(_box()) as bench:
        assert bench.rest.z == pytest.approx(0.04, abs=0.002)
        standing = bench.mesh.vertices @ bench.rest.rotation.T + bench.rest.position
        found = sampled_grasp(standing, bench.mesh.faces, bench.rest.position, HAND, 0.0, 1)
        assert found is not None
        found.frame_from_gripper[:] = np.linalg.inv(bench.world_from_object) @ (
            found.frame_from_gripper
        )
        trials = draws(0, 0, 2, 0.08)
        assert [one.carried for one in bench.try_out(found, HAND, trials)] == [True, True]
        found.frame_from_gripper[:3, 3] += found.frame_from_gripper[:3, 1] * 0.1
        assert not any(one.held for one in bench.try_out(found, HAND, trials))


@pytest.mark.slow
def test_a_trial_depends_on_seed_and_number_alone() -> None:
    settings = {"seed": 5, "trials": 1, "ycb": "", "preset": "fast", "ranked": 2}
    one = quality_trial(settings, 2)
    assert one == quality_trial(settings, 2)
    assert one["hand"] == "panda"
    assert set(one["rules"]) <= set(RULES)
    assert {"lift", "carry", "confidence"} <= set(one["rules"]["planned"]["promised"])
    assert all(len(rule["held"]) == len(rule["carried"]) == 1 for rule in one["rules"].values())
    best, worst = one["ranked"]
    assert best["carry"] == one["rules"]["planned"]["promised"]["carry"] > worst["carry"]
    assert best["carried"] == one["rules"]["planned"]["carried"]


def _result(number: int, planned: float, confidence: float, sampler: float) -> dict[str, Any]:
    def rule(share: float) -> dict[str, Any]:
        held = [k < round(share * 4) for k in range(4)]
        return {"held": held, "carried": held, "promised": {"lift": 0.75, "carry": 0.75}}

    return {
        "hand": "panda" if number % 2 == 0 else "nao",
        "object": f"thing-{number}",
        "rules": {"planned": rule(planned), "confidence": rule(confidence),
                  "sampler": rule(sampler)},
    }  # fmt: skip


@pytest.mark.slow
def test_the_gate_wants_a_pick_that_is_never_below_and_proven_better() -> None:
    better = [_result(n, 1.0, 0.5 if n % 3 else 1.0, 0.75) for n in range(60)]
    summary = summarise_quality(better)
    assert summary["gate"]["passed"]
    assert summary["cases"]["panda, lift"]["planned"]["mean"] == 1.0
    assert summary["cases"]["all"]["minus confidence"]["n"] == 60
    assert summary["cases"]["all"]["minus sampler"]["mean"] == pytest.approx(0.25)
    promise = summary["calibration"]["nao, carry"]
    assert promise["error"] == pytest.approx(0.25)
    assert promise["error_after_50"] < 0.08
    assert promise["covered"] == promise["covered_by_halves"] == 1.0
    assert promise["abstained"] == 0.0
    assert 0.9 <= promise["expected_by_halves"] <= 1.0
    assert promise["covered_95"][0] < 1.0 == promise["covered_95"][1]
    assert promise["widest_gap"] == pytest.approx(max(
        abs(part["promised"] - part["held"]) for part in promise["quarters"]))  # fmt: skip
    assert [part["n"] for part in promise["quarters"]] == [8, 8, 7, 7]
    assert promise["widest_gap_after_50"] < promise["widest_gap"]
    assert promise["less_former"]["n"] == 30
    assert len(quality_rows(summary)) == 5

    same = summarise_quality([_result(n, 0.75, 0.75, 0.75) for n in range(60)])
    assert not same["gate"]["passed"]
    assert same["gate"]["nowhere below the sampler"]
    assert not same["gate"]["better than the former order"]

    worse = summarise_quality([_result(n, 1.0 if n % 2 else 0.5, 0.25, 0.75) for n in range(60)])
    assert not worse["gate"]["nowhere below the sampler"]
    assert worse["gate"]["better than the former order"]
    assert not worse["gate"]["passed"]
    # Half of what is promised in one hand holds: less than the margin of carrying forgives.
    assert worse["calibration"]["nao, lift"]["covered"] == 1.0
    assert worse["calibration"]["panda, lift"]["covered"] == 0.0


def _ranked(*pairs: tuple[float, float]) -> dict[str, Any]:
    return {
        "hand": "panda",
        "ranked": [
            {"carry": score, "carried": [k < round(share * 4) for k in range(4)]}
            for score, share in pairs
        ],
    }


def test_ranks_are_compared_over_all_grasps_and_within_objects() -> None:
    light = _ranked((0.9, 0.75), (0.8, 1.0), (0.7, 0.5))  # the two best are swapped
    heavy = _ranked((0.3, 0.25), (0.2, 0.25), (0.1, 0.0))
    alike = _ranked((0.9, 1.0), (0.8, 1.0), (0.7, 1.0))
    none: dict[str, Any] = {"hand": "panda", "ranked": []}
    found = rank_correlations([light, heavy, none], "carried")
    assert found["grasps"] == 6
    assert found["over"]["n"] == 2
    assert 0.9 < found["over"]["mean"] < 1.0
    assert found["within"]["mean"] == pytest.approx((0.5 + 0.8660) / 2, abs=1e-3)
    # Where all hold nothing can be ranked; over all objects, it counts.
    found = rank_correlations([light, alike], "carried")
    assert (found["within"]["n"], found["over"]["n"]) == (1, 2)
    nothing = rank_correlations([none], "carried")
    assert nothing["over"]["mean"] is None
    assert nothing["attainable"] == {"over": None, "within": None}


def test_where_nearly_all_hold_no_score_can_rank_within_an_object() -> None:
    easy = [_ranked((0.95, 1.0), (0.94, 1.0), (0.93, 1.0)) for _ in range(9)]
    mixed = [_ranked((0.9, 1.0), (0.4, 0.5), (0.05, 0.0)) for _ in range(9)]
    low, high = (rank_correlations(objects, "carried") for objects in (easy, mixed))
    assert low["spread"] == {"always held": 1.0, "never held": 0.0, "objects all alike": 1.0}
    assert high["spread"] == pytest.approx(
        {"always held": 1 / 3, "never held": 1 / 3, "objects all alike": 0.0}, abs=1e-4
    )
    assert low["attainable"]["within"] < 0.3 < 0.6 < high["attainable"]["within"]


def test_objects_without_a_grasp_are_counted_and_leave_the_pairs() -> None:
    results = [_result(n, 1.0, 1.0, 1.0) for n in range(4)]
    del results[0]["rules"]["sampler"]
    del results[2]["rules"]["planned"]
    results.append({"hand": "panda", "object": "anvil", "rules": {}})
    summary = summarise_quality(results)
    assert summary["none"] == {"planned": 2, "confidence": 1, "sampler": 2}
    assert summary["cases"]["all"]["minus sampler"]["n"] == 2
    assert summary["cases"]["all"]["minus confidence"]["n"] == 3
    # Two of the panda's three objects are graspable, and a plan was found for one of them.
    assert summary["coverage"]["panda"]["n"] == 2
    assert summary["coverage"]["panda"]["hits"] == 1
    assert summary["coverage"]["nao"]["share"] == 1.0


@pytest.mark.slow
def test_the_planned_grasps_alone_give_promises_and_coverage(tmp_path: Path) -> None:
    asked = ["--objects", "2", "-n", "2", "--ranked", "0", "--seed", "5", "--workers", "1",
             "--alone", "--out", str(tmp_path)]  # fmt: skip
    done = CliRunner().invoke(grasp_quality, asked)
    assert done.exit_code == 0, done.output
    assert "nao: a grasp on 2 of 2 graspable objects" in done.output
    assert "promised / held by quarters: " in done.output
    report = json.loads((tmp_path / "report.json").read_text())
    assert all(set(result["rules"]) <= {"planned"} for result in report["results"])
    assert report["gate"]["passed"] is False


@pytest.mark.slow
def test_the_command_prints_paired_intervals_and_goes_on_where_it_was(tmp_path: Path) -> None:
    asked = [
        "--objects",
        "1",
        "-n",
        "1",
        "--ranked",
        "2",
        "--seed",
        "5",
        "--workers",
        "1",
        "--out",
        str(tmp_path),
    ]
    done = CliRunner().invoke(grasp_quality, asked)
    assert done.exit_code == 0, done.output
    assert "planned - sampler" in done.output
    assert "gate:" in done.output
    assert "panda, carry: rank correlation" in done.output
    journal = (tmp_path / "journal.jsonl").read_text()
    again = CliRunner().invoke(grasp_quality, [*asked, "--resume", "--json"])
    assert again.exit_code == 0, again.output
    assert (tmp_path / "journal.jsonl").read_text() == journal
    assert json.loads(again.output.splitlines()[-1])["seed"] == 5


def test_public_models_come_in_an_order_of_their_own_and_flat_ones_are_left_out(
    tmp_path: Path,
) -> None:
    box = [f"v {x} {y} {z}" for x in (0, 2) for y in (0, 3) for z in (0, 4)]
    flat = [line[:-1] + "0" for line in box]
    both = {"flat": flat, "one": ["o a", *box], "two": ["o a", *box, "o b", *box]}
    for name, lines in both.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}.obj").write_text("\n".join(lines))
        (tmp_path / name / f"{name}.urdf").write_text('<mesh filename="x" scale="0.01 0.01 0.01"/>')
    models = [public_model(tmp_path, 3, number, panda_hand()) for number in (0, 1)]
    assert {model.name for model in models} == {"one", "two"}
    assert {len(model.parts) for model in models} == {1, 2}
    # 2 x 3 x 4 cm of wood; what two parts share weighs once.
    assert [model.mass for model in models] == pytest.approx([0.0168] * 2, rel=0.1)
    with pytest.raises(UsageError, match="has 2 models that panda"):
        public_model(tmp_path, 3, 2, panda_hand())
    with pytest.raises(UsageError, match="holds no NAME/NAME"):
        public_model(tmp_path / "one", 3, 0, panda_hand())


def test_an_object_that_nobody_finds_a_grasp_of_is_not_missed() -> None:
    tried = {"promised": {}, "held": [True], "carried": [True]}
    results: list[dict[str, Any]] = [
        {"rules": {"planned": tried}, "graspable": True},
        {"rules": {}, "graspable": True},
        {"rules": {}, "graspable": False},
    ]
    assert coverage_of(results)["n"] == 2
    assert coverage_of(results)["share"] == 0.5


def test_maps_of_tried_hands_are_fitted_on_generated_objects_alone() -> None:
    rng = np.random.default_rng(3)
    true = FactoryMap(1.0, 0.6, 0.6, -1.0, 0.0, 0.0, taper=-2.0)
    results = []
    for number in range(400):
        score, taper = float(rng.uniform(0.05, 0.95)), float(rng.uniform(0, 0.8))
        truth = true.chance(score, 0.3, 0.08, taper)
        held = (rng.random(4) < truth).tolist()
        is_known = bool(number % 2)
        promised = {"lift": score, "carry": score, "load": 0.3, "taper": taper}
        results.append({
            "hand": "panda", "object": f"box-{number}" if is_known else "mustard_bottle",
            "rules": {"planned": {"promised": promised, "held": held,
                                  "carried": held if is_known else [False] * 4}},
        })  # fmt: skip
    made = fit_tried(results, "carried", "carry")["panda_hand"]
    assert made.taper == pytest.approx(-2.0, abs=1.2)
    for score, taper in ((0.2, 0.1), (0.6, 0.5)):
        truth = true.chance(score, 0.3, 0.08, taper)
        assert made.chance(score, 0.3, 0.08, taper) == pytest.approx(truth, abs=0.08)
    with pytest.raises(ValueError, match="too few"):
        fit_tried(results[:8], "carried", "carry")
