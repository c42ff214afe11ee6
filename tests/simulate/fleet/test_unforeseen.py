"""Families that the causes do not know: what reasoning about causes costs or saves there."""

from __future__ import annotations

import pytest

from rtask.errors import UsageError
from simulate.fleet.causes_replay import COLUMNS, replay_family, rows_of
from simulate.fleet.unforeseen import FAMILIES, unforeseen_study, unforeseen_trial
from simulate.world.hidden import UNFORESEEN_KINDS
from tests.simulate.fleet.tables import product_with


def test_every_unforeseen_kind_is_in_a_family_beside_known_ones_and_defects_of_a_hand() -> None:
    kinds = {kind for family in FAMILIES.values() for kind in family.kinds}
    assert set(UNFORESEEN_KINDS) < kinds
    assert sum(family.known for family in FAMILIES.values()) == 2
    assert sum(family.defect is not None for family in FAMILIES.values()) == 2


def test_what_a_family_hides_is_learned_from_product_to_product() -> None:
    """Both ends and the middle break; one place beside the middle holds."""
    products = [product_with(k, (2, 4)[k % 2]) for k in range(6)]
    figures = replay_family(products, "panda", 6, seed=1)
    change = figures["robot_1"]["causes less neither"]
    assert change["change"] < 0
    first = figures["robot_1"]
    assert change["change"] == pytest.approx(first["causes"] - first["neither"], abs=1e-3)
    assert figures["robot_2"]["both"] < figures["robot_2"]["neither"]
    for robot in (1, 2):
        (row,) = rows_of({"ends": figures}, robot)
        assert len(row) == len(COLUMNS)


def test_where_any_grasp_holds_nothing_is_lost_or_won() -> None:
    figures = replay_family([product_with(k, None) for k in range(3)], "panda", 2, seed=1)
    assert figures["robot_1"]["causes less neither"]["change"] == 0.0
    assert figures["robot_2"]["both less memory"]["change"] == 0.0


def test_too_few_products_are_refused() -> None:
    with pytest.raises(UsageError, match="needs 3 to 200 products"):
        unforeseen_study(2, 1, "panda", 0)


@pytest.mark.deep
def test_a_product_is_tried_with_its_family_s_hand() -> None:
    study = unforeseen_study(3, 1, "panda", 5)
    settings = {**study.settings, "grasps": 2}
    for number in range(len(FAMILIES)):
        assert unforeseen_trial(settings, number)["arms"]


def test_the_family_where_causes_cost_most_comes_first() -> None:
    def family(change: float) -> dict[str, dict[str, object]]:
        figures = {"change": change, "interval95": [change - 1, change + 1]}
        return {"robot_1": {"causes less neither": figures, "neither": 2.0}}

    families = {"saves": family(-0.5), "costs": family(0.25), "neither": family(0.0)}
    assert [row[0] for row in rows_of(families, 1)] == ["costs", "neither", "saves"]
