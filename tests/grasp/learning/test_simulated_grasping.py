"""Learners of grasping side by side on simulated objects, small enough for every run."""

from __future__ import annotations

import pickle
import re
from collections import Counter
from xml.etree import ElementTree

import numpy as np
import pytest

from grasp.learning.comparison import ROWS, Result, compare, live, transfer
from grasp.learning.contenders import Candidates, Luck, Memory, Oracle
from grasp.learning.metrics import attempts, bootstrap, difference, first_try
from grasp.learning.report import curves_svg, table, text
from grasp.learning.simulated import World, WorldSettings, make_world

pytestmark = pytest.mark.slow

_SMALL = WorldSettings(families=5, objects=24, seed=3, runs=10, samples=40)
# For what holds of any world: a quarter of the time to make.
_TINY = WorldSettings(families=3, objects=6, seed=3, runs=10, samples=40)


@pytest.fixture(scope="module")
def world() -> World:
    return make_world(_SMALL)


@pytest.fixture(scope="module")
def results() -> dict[str, Result]:
    names = ("quadrants TEXPLORE", "candidates random", "candidates oracle", "quadrants oracle",
             "candidates default, good and graph", "candidates graph only, mean")  # fmt: skip
    rows = [row for row in ROWS if f"{row.group} {row.name}" in names]
    found = compare(rows, seeds=6, worlds=1, settings=_SMALL)
    return {f"{r.row.group} {r.row.name}": r for r in found}


def test_the_same_seed_makes_the_same_world() -> None:
    world = make_world(_TINY)
    again = make_world.__wrapped__(_TINY)
    assert again is not world
    for one, other in zip(world.things, again.things, strict=True):
        assert (one.chances == other.chances).all()
        assert (one.good == other.good).all()
        assert (one.extents == other.extents).all()
    assert (world.views == again.views).all()
    assert make_world(_TINY) is world


def test_objects_can_be_grasped_but_not_anyhow(world: World) -> None:
    assert world.views.std(axis=0) == pytest.approx(np.ones(5))
    best = [thing.chances.max() for thing in world.things]
    mean = [thing.chances.mean() for thing in world.things]
    assert min(best) > 0.8
    assert 0.2 < np.mean(mean) < 0.45  # a third of the candidates of the full benchmark hold
    chances = np.concatenate([thing.chances for thing in world.things])
    good, poor = (
        np.corrcoef(chances, np.concatenate([getattr(t, kind) for t in world.things]))[0, 1]
        for kind in ("good", "poor")
    )
    # measured over six draws of 72 objects: .64 to .76 and .42 to .53
    assert 0.55 < good < 0.85
    assert 0.3 < poor < good


def test_what_is_known_decides_how_often_one_tries(results: dict[str, Result]) -> None:
    mean = {name: bootstrap(result.lives, draws=50).value for name, result in results.items()}
    assert mean["candidates oracle"] < 1.05
    assert mean["candidates default, good and graph"] < 1.2
    assert mean["candidates graph only, mean"] < 0.8 * mean["candidates random"]
    assert mean["quadrants oracle"] > 1.5  # the actions' limit, with candidates in any order
    assert mean["quadrants TEXPLORE"] > 2 * mean["candidates default, good and graph"]


def test_the_graph_helps_from_the_first_to_the_last_object(results: dict[str, Result]) -> None:
    lives = results["candidates graph only, mean"].lives
    early = np.mean([life.attempts[:8].mean() for life in lives])
    late = np.mean([life.attempts[-8:].mean() for life in lives])
    assert late < early


def test_families_never_met_are_left_out_of_what_was_learned(results: dict[str, Result]) -> None:
    families = make_world(_SMALL).families()
    for life in results["candidates graph only, mean"].unseen:
        assert len(np.unique(families[life.objects])) == 3
        assert np.isin(families, families[life.objects]).sum() == len(life.objects)
    assert results["quadrants TEXPLORE"].unseen == ()


def test_another_robots_outcomes_help() -> None:
    shared, alone = transfer(seeds=4, worlds=1, settings=_SMALL)
    gained = difference(shared, alone, first_try, draws=300)
    assert gained.low > 0


def test_all_contenders_meet_the_same_luck(world: World) -> None:
    first, second = (live(Oracle(world, 0), world, range(24), seed=9) for _ in range(2))
    assert (first.attempts == second.attempts).all()
    assert [Luck(world, 1).holds(0, c, 0) for c in range(9)] == [
        Luck(world, 1).holds(0, c, 0) for c in range(9)
    ]


def test_the_order_of_what_is_remembered_leaves_no_trace(world: World) -> None:
    forth, back = Memory(world), Memory(world)
    contender = Candidates(world, 0, quality=None, graph=False)
    tried = [(t, contender.grasp(t, Luck(world, 0))) for t in range(8)]
    for thing, attempts_ in tried:
        forth.add(thing, attempts_)
    for thing, attempts_ in tried[::-1]:
        back.add(thing, attempts_[::-1])
    assert (forth.counts(10) == back.counts(10)).all()
    assert forth.counts(10).sum() > 0


def test_a_comparison_as_text_json_and_curves(results: dict[str, Result]) -> None:
    chosen = [results["quadrants TEXPLORE"], results["candidates default, good and graph"]]
    rows = table(chosen, draws=50)
    assert [row["name"] for row in rows] == ["TEXPLORE", "default, good and graph"]
    cell = rows[1]["attempts"]
    assert cell["low"] <= cell["value"] <= cell["high"]
    assert rows[0]["unseen"] is None
    lines = text(chosen, draws=50)
    assert any("3.18" in line for line in lines)  # measured earlier
    assert lines[-1].startswith("first tries that held")
    svg = curves_svg(chosen)
    assert ElementTree.fromstring(svg).tag.endswith("svg")
    # A line of the chart and its sample in the legend for each of both learners.
    lines_drawn = re.findall(r"stroke: (#[0-9a-f]{6}); stroke-width: 1.5", svg)
    assert sorted(Counter(lines_drawn).values()) == [2, 2]
    assert "TEXPLORE</text>" in svg
    assert "default, good and graph</text>" in svg


def test_contenders_cross_to_other_processes() -> None:
    for row in ROWS:
        assert pickle.loads(pickle.dumps(row)).name == row.name
    lives = compare(ROWS[-1:], seeds=2, worlds=1, settings=_TINY, workers=2)[0].lives
    alone = compare(ROWS[-1:], seeds=2, worlds=1, settings=_TINY)[0].lives
    assert [attempts(life).tolist() for life in lives] == [
        attempts(life).tolist() for life in alone
    ]
