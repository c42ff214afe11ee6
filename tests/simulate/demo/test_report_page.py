"""The report as a page: each robot with the graph beside itself without, attempt by attempt."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from simulate.demo.report import robot_totals
from simulate.demo.report_page import report_page

_HAND = {"along_m": 0.03, "across_m": 0.0, "angle": 1.5708, "opening_m": 0.05, "width_m": 0.03}
_MISSED = {"number": 1, "source": "candidate", "reason": "missed", "held": False, "placed": False,
           "place_reason": "", "mean": 0.8, "seconds": {}, "run": 1,
           "hand": {**_HAND, "along_m": -0.02}}  # fmt: skip
_HELD = {**_MISSED, "source": "memory", "reason": "ok", "held": True, "placed": True,
         "place_reason": "ok", "mean": 0.9, "hand": _HAND,
         "alone": "graph: held 1 of 1; alone: 17 mm from there"}  # fmt: skip
_CARTON = {"length_m": 0.1, "weak_m": [-0.05, 0.01], "mass_m": None}


def _met(*attempts: dict[str, Any], **changes: Any) -> dict[str, Any]:
    held = attempts[-1]["held"]
    return {"product": "carton-1", "object_iri": "", "recognised": "", "label": "",
            "confidence": 0.1, "right": None, "in_reach": True, "tries": len(attempts),
            "tries_to_success": len(attempts) if held else None, "held": held, "placed": held,
            "attempts": list(attempts), "hidden": _CARTON} | changes  # fmt: skip


def _page(folder: Path, shared: dict[str, Any], alone: dict[str, Any] | None = None) -> str:
    robots = {"nao-2": [shared], "nao-2-alone": [alone] if alone else []}
    totals = {
        name: robot_totals({"name": name, "encounters": met, "products": [],
                            "known_before": 0, "seconds": 1.0}, 6)
        for name, met in robots.items()
    }  # fmt: skip
    return report_page(folder, {
        "products": "fragile",
        "robots": [totals["nao-2"]],
        "alone_robots": [totals["nao-2-alone"]] if alone else [],
        "objects": [{"robot": "nao-2", **shared}],
        "alone_objects": [{"robot": "nao-2-alone", **alone}] if alone else [],
        "gains": [{"sentence": "With the graph <nao-2> needed less."}],
    })  # fmt: skip


def _cells(page: str) -> list[str]:
    return page.split('<div class="robot">')[1:]


def test_a_robot_stands_beside_itself_without_the_graph_product_by_product(tmp_path: Path) -> None:
    again = {**_HELD, "run": 2, "source": "candidate", "alone": ""}
    page = _page(tmp_path, _met(_HELD), _met(_MISSED, again))
    assert "With the graph &lt;nao-2&gt; needed less." in page
    assert page.count('<section class="row">') == 1
    shared, alone = _cells(page)
    assert "with the graph" in shared
    assert "without it" in alone
    assert 'max="2"' in page  # the slider goes through the attempts of the one that made more
    assert (shared.count("<li "), alone.count("<li ")) == (1, 2)
    bars = re.findall(r'class="count (\w+)"><i style="width:(\d+)%"></i><span>([^<]+)<', page)
    assert bars == [("with", "50", "1"), ("without", "100", "2")]


def test_each_attempt_has_its_belief_its_hand_and_what_the_graph_told(tmp_path: Path) -> None:
    (cell,) = _cells(_page(tmp_path, _met(_MISSED, {**_HELD, "run": 2})))
    assert re.findall(r'data-belief="([\d.]+)" data-hand="([^"]+)"', cell) == [
        ("0.80", "-20.0 0.0 -90.0 50.0"),
        ("0.90", "30.0 0.0 -90.0 50.0"),
    ]
    told = "The graph: held 1 of 1. Geometry alone would have chosen a grasp 17 mm from there."
    assert told in cell
    assert cell.count('class="finger"') == 2
    assert cell.count('class="mark bad"') == cell.count('class="mark good"') == 1
    assert 'class="weak" x="-50.0"' in cell


def test_the_moment_of_success_or_failure_is_shown_first(tmp_path: Path) -> None:
    (tmp_path / "nao-2").mkdir()
    for name in ("01-1-pre_grasp", "01-2-closed", "02-1-pre_grasp", "02-2-held", "02-3-placed"):
        (tmp_path / "nao-2" / f"{name}.jpg").write_bytes(b"")
    (cell,) = _cells(_page(tmp_path, _met(_MISSED, {**_HELD, "run": 2})))
    missed, held = cell.split("<li ")[1:]
    assert missed.index("01-2-closed.jpg") < missed.index("<details>") < missed.index("01-1-pre")
    assert held.index("02-2-held.jpg") < held.index("<details>") < held.index("02-3-placed.jpg")


def test_a_run_of_an_earlier_version_has_a_page_without_drawings(tmp_path: Path) -> None:
    old = {key: value for key, value in _HELD.items() if key != "hand"}
    page = _page(tmp_path, _met(old, hidden=None))
    assert "held and placed" in page
    assert 'class="hands"' not in page
    assert "The drawings" not in page


def test_a_product_that_one_robot_did_not_see_is_said(tmp_path: Path) -> None:
    page = _page(tmp_path, _met(_HELD), _met(_MISSED, product="rod-2"))
    assert page.count("did not see it") == 2


def test_the_page_begins_with_what_the_products_hide(tmp_path: Path) -> None:
    page = _page(tmp_path, _met(_HELD))
    assert page.index("one end of each carton breaks") < page.index("With the graph")
