"""The demo in sentences: true of the figures of the run, and plain where nothing was gained."""

from __future__ import annotations

from typing import Any

from simulate.demo.story import Gain, gains_of, opening, outcome


def _met(product: str, tries: int, held: bool = True, source: str = "candidate") -> dict[str, Any]:
    return {
        "product": product, "tries": tries, "tries_to_success": tries if held else None,
        "held": held, "placed": held, "attempts": [{"source": source}] * tries, "right": True,
    }  # fmt: skip


def test_the_gain_is_that_of_the_products_that_both_tried() -> None:
    shared = [_met("carton-1", 1, source="memory"), _met("bar-2", 2), _met("seen-by-one", 4)]
    apart = [_met("carton-1", 4), _met("bar-2", 2), _met("seen-by-other", 9)]
    gain = Gain("nao-2", shared, apart, ["nao-1"])
    assert gain.sentence() == (
        "With the graph nao-2 needed 3 attempts for 2 products; the same robot without it 6. "
        "One first grasp came from nao-1."
    )


def test_where_not_everything_reached_its_box_the_sentence_counts_what_did() -> None:
    gain = Gain("nao-3", [_met("a", 2)], [_met("a", 6, held=False)], ["nao-1", "nao-2"])
    assert gain.sentence() == (
        "With the graph nao-3 put 1 of 1 product into its box in 2 attempts; the same robot "
        "without it put 0 of 1 product into its box in 6 attempts. No first grasps came from "
        "nao-1 or nao-2."
    )
    dropped = [{**_met("a", 3), "placed": False}]
    assert "without it put 0 of 1" in Gain("nao-3", [_met("a", 2)], dropped, []).sentence()


def test_a_run_that_gained_nothing_says_so() -> None:
    for tries in (2, 3):
        gain = Gain("nao-2", [_met("a", tries)], [_met("a", 2)], ["nao-1"])
        assert "In this run the graph gained nothing." in gain.sentence()
    fewer_held = Gain("nao-2", [_met("a", 1, held=False)], [_met("a", 6)], ["nao-1"])
    assert "gained nothing" in fewer_held.sentence()


def test_without_a_product_in_common_nothing_is_claimed() -> None:
    gain = Gain("nao-2", [_met("a", 1)], [_met("b", 1), _met("a", 0)], ["nao-1"])
    assert "no product in common" in gain.sentence()


def test_outcomes_of_an_earlier_run_are_not_ascribed_to_a_robot_of_this_one() -> None:
    done = [{"name": "nao-1", "encounters": []},
            {"name": "nao-2", "encounters": [_met("a", 1, source="memory")]}]  # fmt: skip
    apart = {1: {"name": "nao-2-alone", "encounters": [_met("a", 3)]}}
    (kept,) = gains_of(done, apart, kept=True)
    (fresh,) = gains_of(done, apart, kept=False)
    assert kept.sentence().endswith("One first grasp came from other robots.")
    assert fresh.sentence().endswith("One first grasp came from nao-1.")
    assert gains_of(done, {}, kept=False) == []


def test_the_opening_says_what_is_hidden_and_who_works_when() -> None:
    secret, watch = opening("hard", ["nao-1", "nao-2", "panda-3"], ["panda-3-alone"])
    assert "breaks when it is pressed" in secret
    assert "nao-1 finds out" in watch
    assert "nao-2 and panda-3 start" in watch
    assert watch.endswith(
        "beside the same robot at the same table without the graph (panda-3-alone)."
    )
    _, two = opening("fragile", ["nao-1", "nao-2", "panda-3"], ["nao-2-alone", "panda-3-alone"])
    assert "the same robots at the same tables without the graph (nao-2-alone, panda" in two
    assert opening("plain", ["nao-1"])[1] == (
        "Watch: nao-1 finds out by trial and writes each outcome into the graph."
    )


def test_a_demo_without_a_comparison_ends_with_what_the_graph_contributed() -> None:
    robot = {"name": "nao-1", "held": 5, "objects_in_reach": 6, "known_before": 0,
             "recognised": 0, "from_memory": 0}  # fmt: skip
    assert "the next robot starts from what it wrote" in outcome({"gains": [], "robots": [robot]})
    second = {**robot, "name": "nao-2", "known_before": 6, "recognised": 6, "from_memory": 4}
    assert outcome({"gains": [], "robots": [robot, second]}) == (
        "nao-2 held 5 of 6 products in reach; it recognised 6, and 4 of its first grasps came "
        "from the graph."
    )


def test_each_robot_that_also_worked_alone_ends_the_demo_with_a_sentence() -> None:
    done = [{"name": name, "encounters": [_met("a", 1, source="memory")]}
            for name in ("nao-1", "nao-2", "panda-3")]  # fmt: skip
    apart = {index: {"name": "", "encounters": [_met("a", 2)]} for index in (2, 1)}
    gains = [gain.to_dict() for gain in gains_of(done, apart, kept=False)]
    assert outcome({"gains": gains, "robots": []}).splitlines() == [
        "With the graph nao-2 needed 1 attempt for 1 product; the same robot without it 2. "
        "One first grasp came from nao-1.",
        "With the graph panda-3 needed 1 attempt for 1 product; the same robot without it 2. "
        "One first grasp came from nao-1 or nao-2.",
    ]
