"""Learners of Gatto 2016, Figure 21, in one world; and what a delay of the actuators costs them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from grasp.charts import curve_chart
from grasp.learning.agents import Dyna, QLearning, RMax, Sarsa, run_episodes
from grasp.learning.agents.texplore import Texplore
from grasp.learning.environments import DelayedActions, TwoRooms
from simulate.study.declaration import Study
from simulate.study.intervals import bootstrap
from simulate.thesis.result import Compared, Result, Setting

__all__ = ["actuator_delay", "learners", "live"]

_MAKERS: Mapping[str, Any] = {
    "TEXPLORE": Texplore, "R-MAX": RMax, "Dyna": Dyna, "Sarsa": Sarsa, "Q-learning": QLearning,
}  # fmt: skip
_EPISODES, _LATE = 20, 10
_DELAY = 2


def _study(name: str, setting: Setting, lives: int, ways: list[list[Any]]) -> Study:
    """Return the study of some learners; a way is a name, a delay and whether it is told."""
    settings = {"seed": setting.seed, "lives": lives, "ways": ways}
    return Study(name, "simulate.thesis.runs.learners:live", settings, lives * len(ways))


def live(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Let a learner live through twenty episodes.

    Returns
    -------
    ``returns`` of the episodes, ``steps`` in all, ``cpu_s``, and the number of the ``way``.
    """
    way, life = divmod(number, settings["lives"])
    name, delay, is_announced = settings["ways"][way]
    seed = settings["seed"] + life
    world = DelayedActions(TwoRooms(), delay, is_announced)
    world.reset(seed=1000 + seed)
    learner = _MAKERS[name](world.bins(TwoRooms.bins()), 4, seed=seed)
    began = time.process_time()
    done = list(run_episodes(learner, world, _EPISODES, seed=seed))
    spent = time.process_time() - began
    return {"way": way, "returns": [e.reward for e in done], "cpu_s": spent,
            "steps": sum(e.steps for e in done)}  # fmt: skip


def _late(lives: list[dict[str, Any]], what: str) -> Compared:
    """Return the mean return of the later episodes, with an interval over lives."""
    means = np.array([np.mean(life["returns"][_LATE:]) for life in lives])
    interval = bootstrap(lambda i: float(means[i].mean()), len(means)) if len(means) > 1 else None
    return Compared(f"{what}: mean return of episodes 11 to 20", float(means.mean()),
                    interval=interval)  # fmt: skip


def learners(setting: Setting) -> Result:
    """Learners of the table in one world: returns by episode, and time for an action."""
    lives = setting.size(20, 3)
    ways = [[name, 0, False] for name in _MAKERS]
    results = setting.trials(_study("learners", setting, lives, ways))
    rows, curves = [], {}
    for way, name in enumerate(_MAKERS):
        mine = [result for result in results if result["way"] == way]
        steps, spent = sum(r["steps"] for r in mine), sum(r["cpu_s"] for r in mine)
        curves[name] = np.mean([r["returns"] for r in mine], axis=0)
        rows += [
            _late(mine, name),
            Compared(f"{name}: time for an action", 1e3 * spent / max(steps, 1), unit="ms"),
        ]
    return Result(
        tuple(rows),
        (
            "the table says yes or no for 18 methods, of which five are built; more episodes are "
            "learned from where less samples are needed, and an action within .1 s is real time",
            "for its column on delays of actuators see gatto-experiment-delay",
            *setting.shrunk("lives of each", 20, lives),
        ),
        {"returns": _chart("Two rooms", curves)},
    )


def _chart(title: str, curves: dict[str, Any]) -> str:
    low = float(min(curve.min() for curve in curves.values()))
    return curve_chart(np.arange(1, _EPISODES + 1), curves, title, "episode", (low, 0.0), "return")


def actuator_delay(setting: Setting) -> Result:
    """Actions that are carried out late, told to the learner or not: what TEXPLORE promises."""
    rows: list[Compared] = []
    curves = {}
    sizes = {"TEXPLORE": setting.size(20, 1), "Dyna": setting.size(20, 3)}
    for name in ("TEXPLORE", "Dyna", "Q-learning"):
        ways: list[list[Any]] = [[name, 0, False], [name, _DELAY, True], [name, _DELAY, False]]
        lives = sizes.get(name, sizes["Dyna"])
        study = _study(f"{name} with late actuators", setting, lives, ways)
        results = setting.trials(study)
        for way, (_, delay, is_announced) in enumerate(ways):
            mine = [result for result in results if result["way"] == way]
            told = "told of" if is_announced else "not told of"
            what = f"{name}, {told} a delay of {delay} steps" if delay else f"{name}, no delay"
            rows.append(_late(mine, what))
            curves[what] = np.mean([r["returns"] for r in mine], axis=0)
    return Result(
        tuple(rows),
        (
            "the table says that TEXPLORE takes delays of actuators, and gives no figures; a "
            "learner is told of the actions that are still to come, after Hester and Stone 2013",
            *setting.shrunk("lives of Dyna and Q-learning", 20, sizes["Dyna"]),
            *setting.shrunk("lives of TEXPLORE, too few for an interval", 20, sizes["TEXPLORE"]),
        ),
        {"returns with late actuators": _chart("Two rooms, late actuators", curves)},
    )
