"""The demo's totals: what counts as recognised, false, held, and how attempts are averaged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from rtask.errors import UsageError
from simulate.demo.console import Console
from simulate.demo.orchestrate import Demo, Settings
from simulate.demo.products import by_product
from simulate.demo.queries import QUESTIONS, Answer
from simulate.demo.report import (
    COLUMNS,
    attempts_to_success,
    comparison,
    mean_attempts,
    own_judgements,
    robot_totals,
    rows,
    show_total,
    write_report,
)
from simulate.demo.report_attempts import attempt_pictures, phase_of


def _met(**changes: Any) -> dict[str, Any]:
    met = {
        "product": "can-1",
        "object_iri": "urn:o:1",
        "recognised": "",
        "label": "",
        "confidence": 0.1,
        "right": None,
        "in_reach": True,
        "tries": 1,
        "tries_to_success": 1,
        "held": True,
        "placed": True,
        "attempts": [
            {
                "number": 1,
                "source": "candidate",
                "reason": "ok",
                "seconds": {"look": 0.5, "ask": 0.1},
            }
        ],
    }
    return {**met, **changes}


def _robot(*met: dict[str, Any]) -> dict[str, Any]:
    products = [m if m["product"] != "can-1" else {**m, "product": f"can-{n}"}
                for n, m in enumerate(met, start=1)]  # fmt: skip
    return {
        "name": "nao-1", "encounters": products, "products": [m["product"] for m in products],
        "known_before": 0, "seconds": 1.0,
    }  # fmt: skip


def test_attempts_average_over_what_was_tried_in_reach_failures_count_one_more_than_the_cap() -> (
    None
):
    met = [
        _met(tries_to_success=1),
        _met(tries_to_success=3),
        _met(tries_to_success=None, tries=4, held=False, placed=False),
        _met(tries_to_success=None, tries=4, held=False, placed=False, in_reach=False),
        _met(tries_to_success=None, tries=0, held=False, placed=False),
    ]
    assert mean_attempts(met, cap=4) == (1 + 3 + 5) / 3


def test_what_fell_into_the_box_on_the_way_counts_one_more_than_its_attempts() -> None:
    fell = _met(tries_to_success=None, tries=2, held=True, placed=True)
    gone = _met(tries_to_success=None, tries=2, held=True, placed=False)
    assert [attempts_to_success(met, cap=4) for met in (fell, gone)] == [3, 5]
    assert robot_totals(_robot(fell), cap=4)["succeeded_at_once"] == 0


def test_no_object_in_reach_has_no_mean() -> None:
    assert mean_attempts([_met(in_reach=False)], cap=4) is None


def test_own_judgements_are_compared_attempt_by_attempt() -> None:
    truth = {"held": True, "placed": False}
    met = _met(
        attempts=[
            {"held": True, "placed": False, "truth": truth},
            {"held": False, "placed": True, "truth": truth},
            {"held": False, "placed": False, "truth": None},
        ]
    )
    assert own_judgements([met]) == (2, 4)


def test_totals_separate_right_from_false_identities() -> None:
    robot = _robot(_met(right=True), _met(right=False), _met(right=None))
    totals = robot_totals(robot, cap=4)
    assert (totals["recognised"], totals["false_identities"]) == (1, 1)


def test_objects_that_stand_for_no_product_or_a_known_one_are_counted() -> None:
    robot = _robot(_met(), _met(object_iri="urn:o:2"), _met(object_iri="urn:o:3", product=""))
    robot["encounters"][1]["product"] = "can-1"  # met a second time, and not recognised
    robot["products"] = ["can-1", "pen-9"]
    products: dict[str, str] = {}
    scored = Demo._score(robot, products)
    totals = robot_totals(scored, cap=4)
    assert (totals["false_objects"], totals["false_identities"]) == (2, 0)
    assert totals["never_seen"] == ["pen-9"]
    assert show_total(totals["never_seen"]) == "pen-9"
    assert products == {"urn:o:1": "can-1", "urn:o:2": "can-1", "urn:o:3": ""}
    again = _robot(_met(recognised="urn:o:2", right=None))
    again["encounters"][0]["product"] = "can-1"
    assert robot_totals(Demo._score(again, products), cap=4)["false_objects"] == 0


def test_held_counts_only_what_was_in_reach() -> None:
    robot = _robot(_met(), _met(in_reach=False), _met(held=False, placed=False))
    totals = robot_totals(robot, cap=4)
    assert (totals["objects_in_reach"], totals["held"], totals["placed"]) == (2, 1, 1)


def test_the_table_has_a_cell_for_every_column() -> None:
    assert {len(row) for row in rows([_robot(_met(), _met(held=False))])} == {len(COLUMNS)}


def test_an_object_that_went_before_it_was_tried_has_a_row_too() -> None:
    robot = _robot(_met(attempts=[], tries=0, held=False, tries_to_success=None))
    (row,) = rows([robot])
    assert (row[COLUMNS.index("grasp from")], row[COLUMNS.index("reason")]) == ("-", "gone")
    assert robot_totals(robot, cap=4)["from_memory"] == 0


def test_an_object_is_the_product_it_was_first_made_from() -> None:
    products: dict[str, str] = {}
    Demo._score(_robot(_met(product="can-1", object_iri="urn:o:1")), products)
    second = Demo._score(
        _robot(
            _met(product="can-1", recognised="urn:o:1"),
            _met(product="can-2", recognised="urn:o:1"),
            _met(product="can-3", object_iri="urn:o:2"),
        ),
        products,
    )
    assert [met["right"] for met in second["encounters"]] == [True, False, None]
    assert second["known_before"] == 1


def test_something_that_is_no_product_is_never_recognised_rightly() -> None:
    products: dict[str, str] = {}
    Demo._score(_robot(_met(product="", object_iri="urn:o:1")), products)
    again = Demo._score(_robot(_met(product="", recognised="urn:o:1")), products)
    assert again["encounters"][0]["right"] is False


def test_the_report_holds_the_table_the_answers_and_the_result(tmp_path: Path) -> None:
    robot = _robot(_met(label="can 17"))
    result = {"robots": [robot_totals(robot, 4)], "seed": 3}
    answer = Answer(QUESTIONS[0], ("id", "robot"), (("rtask/1", "nao-1"),))
    write_report(tmp_path, result, rows([robot]), [answer])
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<th>nao-1</th>" in page
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["seed"] == 3
    assert "| nao-1 | can-1 | can 17 |" in text
    assert "| rtask/1 | nao-1 |" in text
    assert "PREFIX rt:" in text


def test_pictures_stand_under_the_object_and_what_came_of_the_attempt(tmp_path: Path) -> None:
    attempt = {"number": 1, "source": "memory", "seconds": {}, "place_reason": "", "placed": False}
    failed = {**attempt, "reason": "missed", "held": False, "run": 1}
    held = {**attempt, "reason": "ok", "held": True, "placed": True, "place_reason": "ok", "run": 2}
    never = {**attempt, "reason": "ik", "held": False, "run": 0}
    robot = _robot(_met(attempts=[failed, held], recognised="o:1", label="can 17"),
                   _met(attempts=[never]))  # fmt: skip
    for name in ("01-1-pre_grasp", "01-2-closed", "02-1-pre_grasp"):
        (tmp_path / "nao-1").mkdir(exist_ok=True)
        (tmp_path / "nao-1" / f"{name}.png").write_bytes(b"png")
    result = {
        "robots": [robot_totals(robot, 4)],
        "objects": [{"robot": "nao-1", **met} for met in robot["encounters"]],
    }
    write_report(tmp_path, result, rows([robot]), [])
    pictures = (tmp_path / "report.md").read_text(encoding="utf-8").split("## Pictures")[1]
    first, second = pictures.split("### ")[1:]
    assert first.startswith("nao-1: can-1, known as can 17; not held: missed\n")
    assert "| pre grasp | closed |" in first
    assert "![01-2-closed](nao-1/01-2-closed.png)" in first
    assert second.startswith("nao-1: can-1, known as can 17; held and placed\n")
    assert pictures.count("![") == 3


def test_pictures_of_another_attempt_of_the_same_number_are_not_shown(tmp_path: Path) -> None:
    for name in ("01-1-pre_grasp", "01-2-closed", "01-3-held"):
        (tmp_path / "alone").mkdir(exist_ok=True)
        (tmp_path / "alone" / f"{name}.jpg").write_bytes(b"jpg")
    attempt = {"run": 1, "pictures": ["pre_grasp", "closed"]}
    shown = [phase_of(path) for path in attempt_pictures(tmp_path, "alone", attempt)]
    assert shown == ["pre_grasp", "closed"]
    assert len(attempt_pictures(tmp_path, "alone", {"run": 1})) == 3


def test_the_table_says_what_the_graph_had_to_say_of_the_first_grasp() -> None:
    known = _met(attempts=[{"source": "candidate", "reason": "ok", "seconds": {},
                            "told": [0.5, 0.04]}])  # fmt: skip
    first, second = rows([_robot(known, _met())])
    column = COLUMNS.index("told")
    assert (first[column], second[column]) == ("0.5 : 0.0", "-")


def test_an_object_that_was_lost_and_met_again_counts_once() -> None:
    lost = _met(product="pen-3", tries=2, tries_to_success=None, held=False, placed=False)
    again = _met(product="pen-3", tries=1, tries_to_success=1)
    dropped = _met(product="can-9", placed=False)
    gone = _met(product="can-9", tries=0, tries_to_success=None, held=False, placed=False)
    totals = robot_totals(_robot(lost, again, dropped, gone), cap=4)
    assert (totals["objects"], totals["objects_in_reach"]) == (2, 2)
    assert (totals["held"], totals["placed"]) == (2, 1)
    assert totals["mean_attempts_to_first_success"] == (3 + 1) / 2


def test_an_object_met_twice_is_joined_without_identities_too() -> None:
    met = [_met(product="it", tries=1), _met(product="it", tries=2)]
    for one in met:
        del one["right"]
    (joined,) = by_product(met)
    assert joined["tries"] == 3


def test_the_last_robot_is_set_beside_itself_without_the_graph() -> None:
    told = "graph: held 1 of 1; alone: 31 mm from there"
    known = _met(product="carton-1", tries=1, tries_to_success=1,
                 attempts=[{"source": "memory", "alone": told}])  # fmt: skip
    fresh = _met(product="carton-1", tries=3, tries_to_success=3)
    never = _met(product="bar-2", tries=4, tries_to_success=None, attempts=[])
    rows_beside = comparison([known, never], [fresh])
    assert rows_beside == [
        ("carton-1", "1", "3", "memory", told),
        ("bar-2", "> 4", "-", "-", ""),
    ]


def test_a_cautious_demo_asks_its_robots_for_caution(tmp_path: Path) -> None:
    bold, careful = (
        Demo(settings, Console(results=False))._job(tmp_path, "nao-1", "", 0)
        for settings in (Settings(tmp_path), Settings(tmp_path, min_grasp=0.4, cautious=True))
    )
    bold, careful = bold.thresholds.as_request(), careful.thresholds.as_request()
    assert (bold["min_grasp"], bold["cautious"]) == (0.1, False)
    assert (careful["min_grasp"], careful["cautious"]) == (0.4, True)


def test_the_hard_products_go_to_robots_that_can_lift_them(tmp_path: Path) -> None:
    hard = Settings(tmp_path, products="hard")
    assert (hard.kind_of(0), hard.compared) == ("panda", (1,))
    assert Settings(tmp_path, products="hard", robots=4).compared == (1, 3)
    assert Settings(tmp_path, products="hard", robots=1).compared == ()
    plain = Settings(tmp_path)
    assert (plain.kind_of(1), plain.compared) == ("nao", ())
    assert Settings(tmp_path, kinds=("nao", "panda"), products="hard").kind_of(1) == "panda"
    with pytest.raises(UsageError, match="there is no set 'odd'"):
        Settings(tmp_path, products="odd")
