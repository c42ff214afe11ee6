"""The proof: which table it takes, what it says was shown, and a whole run with real processes."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtask.errors import UsageError
from simulate.commands import demo
from simulate.demo.proof import ProofSettings, jobs_at_tables
from simulate.demo.proof_page import write_proof
from simulate.demo.proof_words import find_evidence, proof_points, proof_rows, reliance
from simulate.demo.robot_process import lay_table
from tests.commands import run_command

TITLES = ("alone", "with the graph", "with a shuffled graph", "withdrawn", "undone")


def _run(*tries: tuple[str, bool]) -> dict[str, Any]:
    """Return a run at one product: the source of each grasp, and whether it held."""
    attempts = [
        {
            "source": source, "held": held, "placed": held, "physical": True, "grasp": f"g{k}",
            "reason": "ok" if held else "missed", "place_reason": "ok" if held else "",
            "alone": "", "mean": 0.5, "run": k + 1,
        }
        for k, (source, held) in enumerate(tries)
    ]  # fmt: skip
    met = {
        "product": "carton-1", "tries": len(tries), "tries_to_success": None, "held": True,
        "placed": True, "attempts": attempts, "recognised": "", "object_iri": "urn:o",
    }  # fmt: skip
    return {"encounters": [met]}


FAILED, HELD = _run(("candidate", False), ("candidate", True)), _run(("memory", True))
EVIDENCE = [
    {"attempt": "urn:a", "robot": "nao-1", "time": "2026-03-01T11:14:56.2Z", "held": True,
     "same_grasp": True, "picture": "ab", "picture_url": "http://h/ab"},
]  # fmt: skip


def _points(**changed: dict[str, Any]) -> list[bool]:
    runs = dict(zip(TITLES, (FAILED, HELD, FAILED, FAILED, HELD), strict=True)) | changed
    return [point["shown"] for point in proof_points(runs, TITLES, EVIDENCE)]


@pytest.mark.parametrize("weak", ["left", "right"])
def test_the_weak_end_is_where_the_audience_wants_it_and_changes_sides_when_turned(
    weak: str,
) -> None:
    settings = ProofSettings(Path("proof"), weak, seed=1)  # type: ignore[arg-type]
    first, turned, *_ = jobs_at_tables(settings)
    sides = []
    for job in (first, turned):
        (placed,) = lay_table(job)
        part = next(p for p in placed.spec.secret.parts if np.isfinite(p.breaks_at_n))
        sides.append("left" if part.position[0] * np.sin(placed.yaw) > 0 else "right")
    assert sides == [weak, {"left": "right", "right": "left"}[weak]]
    assert dataclasses.replace(first, turned=True) == turned
    assert turned.mirrored != jobs_at_tables(
        ProofSettings(Path("proof"), sides[1], seed=1)  # type: ignore[arg-type]
    )[0].mirrored  # fmt: skip


def test_each_point_depends_on_its_own_run() -> None:
    assert _points() == [True] * 6
    assert _points(alone=HELD) == [False, *[True] * 5]
    assert _points(**{"with a shuffled graph": HELD}) == [True, False, *[True] * 4]
    luck = _run(("candidate", True))  # held at once, but not because of the graph
    assert _points(**{"with the graph": luck}) == [True, True, False, True, True, True]
    assert _points(withdrawn=luck) == [*[True] * 4, False, True]
    assert _points(undone=FAILED) == [*[True] * 5, False]


def test_one_whose_object_was_lost_on_the_way_has_not_held() -> None:
    lost = _run(("memory", True))
    lost["encounters"][0]["attempts"][0]["place_reason"] = "slip_transport"
    assert not _points(undone=lost)[5]
    assert _points(alone=lost)[0]


def test_attempts_stand_side_by_side() -> None:
    rows = proof_rows({"a": FAILED, "b": HELD}, ("a", "b"))
    assert [row[0] for row in rows] == ["1", "2"]
    assert rows[0][2].startswith("held")
    assert rows[1][2] == ""


def test_what_it_relied_on_is_named_and_nothing_is_made_up() -> None:
    attempt = HELD["encounters"][0]["attempts"][0]
    named = "nao-1, 11:14:56 UTC: held, the grasp that it repeated: urn:a"
    assert named in reliance(attempt, EVIDENCE)
    assert "http://h/ab" in reliance(attempt, EVIDENCE)
    assert "none" in reliance(attempt, [])
    assert find_evidence(object(), "", "nao-2", attempt) == []  # type: ignore[arg-type]


def result_of_a_proof() -> dict[str, Any]:
    """Return what a proof that showed all its points prints as JSON."""
    runs = dict(zip(TITLES, (FAILED, HELD, FAILED, FAILED, HELD), strict=True))
    return {
        "carton": "carton-1", "weak": "left", "robot": "nao-2", "teacher": "nao-1",
        "runs": {
            title: run["encounters"]
            for title, run in {"the teacher": FAILED, "the other teacher": FAILED, **runs}.items()
        },
        "relied_on": EVIDENCE, "points": proof_points(runs, TITLES, EVIDENCE), "shown": True,
    }  # fmt: skip


def test_the_page_shows_the_runs_and_the_points(tmp_path: Path) -> None:
    result = result_of_a_proof()
    write_proof(tmp_path, result)
    page = (tmp_path / "proof.html").read_text("utf-8")
    assert page.count('<div class="robot">') == 7
    assert page.count(">yes</b>") == 6
    assert json.loads((tmp_path / "report.json").read_text("utf-8")) == result


def test_options_of_others_are_refused() -> None:
    for arguments, what in (
        (("--proof", "--objects", "3"), "--objects"),
        (("--weak", "left"), "--weak"),
        (("--page",), "--page"),
        (("--proof", "--robot", "nao", "--robot", "panda"), "--robot"),
    ):
        with pytest.raises(UsageError, match=what):
            demo.main(list(arguments), standalone_mode=False)
    with pytest.raises(UsageError, match="--attempts"):
        ProofSettings(Path("proof"), "left", max_attempts=0)


@pytest.mark.deep
@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("weak", ["left", pytest.param("right", marks=pytest.mark.night)])
def test_a_proof_shows_its_points_with_either_end_weak(tmp_path: Path, weak: str) -> None:
    arguments = ("demo", "--proof", "--weak", weak, "--data", str(tmp_path / "proof"), "--json")
    done = run_command(*arguments, timeout=800)
    assert done.returncode == 0, done.stderr[-3000:]
    result = json.loads(done.stdout)
    assert [point["text"] for point in result["points"] if not point["shown"]] == []
    assert result["withdrawn"]["objects"] == 1
    relied = [row for row in result["relied_on"] if row["same_grasp"]]
    assert {row["robot"] for row in relied} == {result["teacher"]}
    report = tmp_path / "proof" / "report"
    assert all((report / row["file"]).stat().st_size > 1000 for row in relied)
