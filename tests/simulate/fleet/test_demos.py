"""The study of demos: who works on which graph, and what is counted."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rtask.errors import UsageError
from simulate.demo.orchestrate import objects_on_table, robots_in_all
from simulate.fleet import demos
from simulate.fleet.demos import (
    COLUMNS,
    demo_rows,
    demo_study,
    demo_trial,
    demo_words,
    summarise_demos,
)

NOTE = "INSERT DATA { GRAPH <%s> { <urn:%s> a <urn:Robot> } }"
NOTED = "SELECT DISTINCT ?robot { GRAPH ?g { ?robot a <urn:Robot> } } ORDER BY ?robot"


def _met(product: str, tries: int | None, source: str = "candidate") -> dict[str, Any]:
    """Return an encounter that needed a number of tries; None = it never succeeded in six."""
    made = tries or 6
    attempts = [
        {"source": source if not k else "candidate", "held": k + 1 == tries, "physical": True,
         "place_reason": "ok"}
        for k in range(made)
    ]  # fmt: skip
    return {
        "product": product, "in_reach": True, "tries": made, "tries_to_success": tries,
        "held": tries is not None, "placed": tries is not None, "attempts": attempts,
        "right": None,
    }  # fmt: skip


def _robot(*met: dict[str, Any]) -> dict[str, Any]:
    return {"name": "nao-2", "encounters": list(met)}


def _demo(seed: int, shared: dict[str, Any], alone: dict[str, Any]) -> dict[str, Any]:
    teacher = _robot(_met("rod", 2), _met("carton", 3))
    return {
        "seed": seed, "shared": [teacher, shared], "compared": [1], "alone": [alone], "cpu_s": 1.0
    }  # fmt: skip


def test_the_robots_share_a_graph_and_the_second_and_the_last_work_once_more_on_their_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    worked: list[tuple[str, int, list[str]]] = []

    def work(job: Any, body: Any, client: Any, *, tell: Any) -> dict[str, Any]:
        there = [row["robot"].removeprefix("urn:") for row in client.query(NOTED)]
        worked.append((job.name, job.seed, there))
        graph = client.engine.kb.graphs.agent(job.name).value
        client.update(NOTE % (graph, job.name))
        return _robot(_met("rod", 1))

    monkeypatch.setattr(demos, "make_body", lambda job, _: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(demos, "clear_table", work)
    study = demo_study(2, 3, 1, 40, "fragile", (), 6, "fast")
    result = demo_trial(study.settings, 1)
    assert worked == [
        ("nao-1", 41, []), ("nao-2", 41, ["nao-1"]), ("panda-3", 41, ["nao-1", "nao-2"]),
        ("nao-2", 41, []), ("panda-3", 41, []),
    ]  # fmt: skip
    assert (result["seed"], result["compared"]) == (41, [1, 2])
    # Printed as each demo ends, so that an interrupted study has said what it found.
    assert result["says"] == "seed 41: nao-2 1, alone 1; nao-2 1, alone 1"


def test_what_two_robots_gained_is_shown_for_each_and_added_up() -> None:
    better, worse = _robot(_met("rod", 1, "memory")), _robot(_met("rod", 3))
    alone = [_robot(_met("rod", 4)), _robot(_met("rod", 2))]
    demo = {"seed": 5, "shared": [_robot(_met("rod", 2)), better, worse], "compared": [1, 2],
            "alone": alone, "cpu_s": 1.0}  # fmt: skip
    summary = summarise_demos([demo], 6)
    assert summary["demos"][0]["pairs"] == [[1, 4], [3, 2]]
    assert summary["lessons"] == {
        "won": 2,
        "recalled": 1,
        "followed": 0,
        "unreachable": 0,
        "held_elsewhere": 0,
        "same_place": 0,
        "places": 0,
        "same_place_alone": 0,
        "places_alone": 0,
    }
    (row,) = demo_rows(summary)
    assert row[COLUMNS.index("robot by robot")] == "nao-2 1, alone 4; nao-2 3, alone 2"


def test_products_of_a_set_have_the_robot_that_suits_them() -> None:
    light = demo_study(1, 3, 6, 0, "fragile", (), 6, "fast").settings
    assert light["kinds"] == ["nao", "nao", "panda"]
    assert demo_study(1, 2, 6, 0, "hard", (), 6, "fast").settings["kinds"] == ["panda"] * 2
    with pytest.raises(UsageError, match="--robots"):
        demo_study(1, 1, 6, 0, "fragile", (), 6, "fast")


def test_a_table_has_as_many_light_products_as_a_nao_reaches_unless_a_number_is_given() -> None:
    numbers = [objects_on_table(name) for name in ("light", "fragile", "hard", "plain")]
    assert numbers == [4, 4, 6, 6]
    assert objects_on_table("light", 2) == 2


def test_two_naos_are_followed_by_a_panda_unless_other_robots_are_asked_for() -> None:
    assert [robots_in_all(products, ()) for products in ("fragile", "hard", "plain")] == [3, 2, 2]
    assert robots_in_all("light", ("nao",)) == 2
    assert robots_in_all("light", ("nao", "panda", "nao")) == 3
    assert robots_in_all("plain", (), 1) == 1


def test_attempts_are_paired_by_product_and_what_only_one_tried_is_left_out(
    tmp_path: Path,
) -> None:
    better = _demo(
        7, _robot(_met("rod", 1, "memory"), _met("carton", 1, "memory"), _met("odd", 1)),
        _robot(_met("rod", 2), _met("carton", 3)),
    )  # fmt: skip
    worse = _demo(
        8, _robot(_met("rod", None, "memory"), _met("carton", 1)),
        _robot(_met("rod", 1), _met("carton", 1)),
    )  # fmt: skip
    summary = summarise_demos([better, worse], 6)
    assert [demo["pairs"] for demo in summary["demos"]] == [[[1, 3], [1, 2]], [[1, 1], [7, 1]]]
    assert summary["change"]["mean"] == (-3 + 6) / 4
    assert summary["change"]["interval95"] == [-1.5, 3.0]  # of whole demos, not of products
    assert (summary["fewer"], summary["many_more"]) == (1, 1)
    assert summary["lessons"] == {
        "won": 4,
        "recalled": 3,
        "followed": 0,
        "unreachable": 0,
        "held_elsewhere": 1,
        "same_place": 0,
        "places": 0,
        "same_place_alone": 0,
        "places_alone": 0,
    }
    assert demo_rows(summary)[0] == (
        "7", "2", "2", "5", "nao-2 2, alone 5", "2", "0", "2 of 2", "2 of 2"
    )  # fmt: skip
    assert len(demo_rows(summary)[1]) == len(COLUMNS)
    assert "+0.75 [-1.50, +3.00] over 4 products" in demo_words(summary)[0]
    assert demo_words(summary)[-1] == (
        "nao-2: 2.50 attempts with the graph, 1.75 without; first tries that held 0.75 and 0.50; "
        "fewer attempts in 1 demos, more in 1, of these more than 2 more in 1; "
        "never delivered 1 and 0"
    )
    study = demo_study(2, 3, 2, 7, "fragile", (), 6, "fast")
    report = study.describe([better, worse], study.settings, tmp_path)
    assert report.figures["change"] == summary["change"]
    assert report.lines == demo_words(summary)


def test_demos_without_a_common_product_say_so() -> None:
    nothing = _demo(1, _robot(_met("odd", 1)), _robot(_met("rod", 1)))
    assert demo_words(summarise_demos([nothing], 6)) == ["no product was tried both ways"]
