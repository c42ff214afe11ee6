"""A policy that one robot learned, found in the graph and used by another (Kehoe 2014, 1.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import rtask
from grasp.charts import curve_chart
from grasp.learning.agents import QLearning, RMax, run_episodes
from grasp.learning.environments import TwoRooms
from rtask.engine.engine import Engine
from rtask.engine.memory.learners import Training, adopt_policy, keep_learner
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from simulate.study.declaration import Study
from simulate.study.intervals import bootstrap
from simulate.thesis.result import Compared, Result, Setting, share_of

__all__ = ["pair", "policies"]

_MAKERS: Mapping[str, Any] = {"R-MAX": RMax, "Q-learning": QLearning}
_EPISODES, _LATEST, _WINDOW = 20, 10, 5
_RETURN = -25.0
"""Twice what the shortest ways cost: the mean of five episodes in turn has to reach it."""
_PLACE, _ELSEWHERE = "TwoRooms, moves go aside with .2", "a lab that nobody learned in"
_OWNER, _OTHER = "nao-1", "nao-2"


def pair(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Let one robot learn and store its policy; another lives alone, and with what it finds.

    Returns
    -------
    ``alone`` and ``shared``: returns and steps of the other's episodes. ``intact`` and ``gone``:
    whether the policy withstood the other robot, and was not found once its owner was withdrawn;
    ``strange``: whether one was found for an environment in which nobody had learned.
    """
    way, life = divmod(number, settings["lives"])
    name, seed = list(_MAKERS)[way], settings["seed"] + life
    teacher = _learner(name, seed)
    taught = _live(teacher, seed)
    with rtask.open(":memory:", reason=False) as kb, Engine(kb) as engine:
        latest = float(np.mean(taught["returns"][-_LATEST:]))
        node = keep_learner(
            engine.context, teacher, "policy", _OWNER, int(sum(taught["steps"])),
            Training(_PLACE, _EPISODES, latest),
        )  # fmt: skip
        other = _learner(name, 5000 + seed)
        adopted = adopt_policy(engine.context, other, _PLACE)
        intact = adopted.snapshot == node and _withstands(kb, node)
        strange = adopt_policy(engine.context, _learner(name, seed), _ELSEWHERE).done
        request = {"contributor": _OWNER, "operator": "keeper"}
        engine.call("withdraw_contributor", request, Access("keeper", "teacher"))
        gone = not adopt_policy(engine.context, _learner(name, seed), _PLACE).done
    return {
        "way": way, "intact": bool(intact), "gone": gone, "strange": strange,
        "alone": _live(_learner(name, 5000 + seed), 2000 + seed),
        "shared": _live(other, 2000 + seed),
    }  # fmt: skip


def _withstands(kb: rtask.KnowledgeBase, node: str) -> bool:
    """Whether another robot is refused when it would take the policy away, or leaves it."""
    before = len(kb.match(rtask.rdf.terms.iri(node)))
    try:
        kb.update(f"DELETE WHERE {{ GRAPH ?g {{ <{node}> ?p ?o }} }}", agent=_OTHER)
    except ForbiddenError:
        return True
    return len(kb.match(rtask.rdf.terms.iri(node))) == before


def _learner(name: str, seed: int) -> Any:
    return _MAKERS[name](TwoRooms.bins(), 4, seed=seed)


def _live(learner: Any, seed: int) -> dict[str, list[float]]:
    """Return the returns and the steps of the episodes that a learner lives through."""
    world = TwoRooms()
    world.reset(seed=1000 + seed)
    done = list(run_episodes(learner, world, _EPISODES, seed=seed))
    return {"returns": [e.reward for e in done], "steps": [e.steps for e in done]}


def _steps_to_return(lived: Mapping[str, list[float]]) -> float:
    """Return the steps after which five episodes in turn were good enough; all if never."""
    for last in range(_WINDOW, _EPISODES + 1):
        if np.mean(lived["returns"][last - _WINDOW : last]) >= _RETURN:
            return float(sum(lived["steps"][:last]))
    return float(sum(lived["steps"]))


def policies(setting: Setting) -> Result:
    """Steps that a robot needs alone, and with the policy that another one learned."""
    lives = setting.size(20, 5)
    settings = {"seed": setting.seed, "lives": lives}
    study = Study(
        "shared policies", "simulate.thesis.runs.shared_policy:pair", settings,
        lives * len(_MAKERS),
    )  # fmt: skip
    results = setting.trials(study)
    rows: list[Compared] = []
    curves = {}
    for way, name in enumerate(_MAKERS):
        mine = [result for result in results if result["way"] == way]
        for word, what in (("alone", "alone"), ("shared", "with the other's policy")):
            steps = np.array([_steps_to_return(result[word]) for result in mine])
            rows.append(_mean(f"{name}, {what}: steps until {_WINDOW} episodes reach the return",
                              steps))  # fmt: skip
            curves[f"{name}, {what}"] = np.mean([r[word]["returns"] for r in mine], axis=0)
        spared = np.array(
            [_steps_to_return(r["alone"]) - _steps_to_return(r["shared"]) for r in mine]
        )
        rows.append(_mean(f"{name}: steps spared by the other's policy, in pairs", spared))
    count = len(results)
    rows += [
        share_of("policies found that withstood the other robot", _sum(results, "intact"), count),
        share_of("policies not found any more once their robot was withdrawn",
                 _sum(results, "gone"), count),
        share_of("found for an environment in which nobody learned", _sum(results, "strange"),
                 count),
    ]  # fmt: skip
    low = float(min(curve.min() for curve in curves.values()))
    chart = curve_chart(
        np.arange(1, _EPISODES + 1), curves, "Two rooms", "episode", (low, 0.0), "return"
    )
    return Result(
        tuple(rows),
        (
            "the thesis names the sharing of control policies as a use of the cloud, without a "
            "figure; the policy is the learner's table, which the second robot finds by its "
            f"environment and goes on learning with; the return is {_RETURN:g}",
            *setting.shrunk("pairs of robots for each learner", 20, lives),
        ),
        {"returns of the second robot": chart},
    )


def _mean(what: str, values: np.ndarray[Any, Any]) -> Compared:
    interval = bootstrap(lambda i: float(values[i].mean()), len(values))
    return Compared(what, float(values.mean()), interval=interval)


def _sum(results: list[dict[str, Any]], name: str) -> int:
    return sum(bool(result[name]) for result in results)
