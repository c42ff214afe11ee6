"""Entries whose run draws nothing have charts of their figures in the report."""

from __future__ import annotations

import pytest

from grasp.charts import Figures, figure_chart
from simulate.thesis.charts import pictures_of
from simulate.thesis.entry import Entry
from simulate.thesis.page import to_html
from simulate.thesis.result import Compared, Result, Setting
from simulate.thesis.running import Outcome

ENTRY = Entry("kehoe", "table", "9.9", "9", "a table", "compared", run="made:up")


def test_the_figures_of_each_unit_are_a_chart_with_the_thesiss_beside_ours():
    rows = (
        Compared("recall", 0.9, 0.8, interval=(0.85, 0.95)),
        Compared("false", 0.1, interval=(0, 0.2)),
        Compared("time", 3.0, 4.0, unit="s"), Compared("mass", 5.0, unit="kg"),
        Compared("nothing of ours", None, 4.0, unit="kg"),
    )  # fmt: skip
    drawn = pictures_of(ENTRY, Result(rows))
    assert list(drawn) == ["shares and numbers", "figures in s"], "a single number is no chart"
    shares = str(drawn["shares and numbers"])
    assert ">recall</text>" in shares
    assert ">theirs</text>" in shares
    assert ">a table</text>" in shares


def test_what_a_run_draws_itself_stays_alone():
    assert pictures_of(ENTRY, Result((Compared("x", 1.0, 2.0),), pictures={"own": "<svg/>"})) == {
        "own": "<svg/>"
    }


def test_the_report_shows_a_chart_for_a_run_that_draws_nothing():
    machine = {"cores": 2, "processor": "some", "load": 0.1, "python": "3.11"}
    outcomes = [Outcome(ENTRY, Result((Compared("recall", 0.9, 0.8),)))]
    html = to_html(Setting(), machine, outcomes)
    assert html.count("<figure><svg") == 1
    assert "<figcaption>shares and numbers</figcaption>" in html


def test_more_rows_than_can_be_read_are_several_charts():
    rows = tuple(Compared(f"row {k}", float(k), 1.0) for k in range(30))
    first, second = pictures_of(ENTRY, Result(rows)).values()
    assert ">row 23</text>" in str(first)
    assert ">row 24</text>" in str(second)


@pytest.mark.parametrize(("least", "is_logarithmic"), [(1.0, True), (0.0, False), (30.0, False)])
def test_the_axis_is_logarithmic_where_figures_span_orders(least, is_logarithmic):
    svg = figure_chart([Figures("a", least), Figures("b", 100.0)], "t", "s")
    assert ("10^{" in svg) is is_logarithmic
