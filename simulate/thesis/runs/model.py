"""The model module of Gatto 2016: Figures 15, 16 and 21 to 23."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

import ontology as terms
import rtask
from features.geometry import finite_depth
from grasp.charts import curve_chart
from grasp.learning.agents import Dyna, QLearning, RMax, Sarsa, run_episodes
from grasp.learning.agents.texplore import Texplore
from grasp.learning.environments import TwoRooms
from grasp.learning.state import GrowingComponents, pooled
from grasp.spatial.grasp_plan import plan_on_cloud
from grasp.spatial.gripper import nao_hand
from rtask.rdf.terms import prologue
from simulate.thesis.result import Compared, Result, Setting, counted
from simulate.thesis.runs.pictures import png
from simulate.thesis.runs.products import STAND_INS, turned

__all__ = ["candidates", "learners", "object_state", "ontology", "task_properties"]


def ontology(setting: Setting) -> Result:
    """Classes of the ontology, and how many of them extend CORA's."""
    with rtask.open(":memory:") as kb:

        def count(text: str) -> float:
            return float(len(list(kb.select(prologue(terms.PREFIXES) + text))))

        rows = (
            Compared("classes of RTASK", count(
                "SELECT DISTINCT ?c WHERE { ?c a owl:Class "
                "FILTER(isIRI(?c) && STRSTARTS(STR(?c), STR(rt:))) }")),
            Compared("classes of CORA", count(
                "SELECT DISTINCT ?c WHERE { ?c a owl:Class "
                "FILTER(isIRI(?c) && STRSTARTS(STR(?c), STR(cora:))) }")),
            Compared("classes of RTASK below one of CORA", count(
                "SELECT DISTINCT ?c WHERE { ?c rdfs:subClassOf ?of "
                "FILTER(STRSTARTS(STR(?c), STR(rt:)) && STRSTARTS(STR(?of), STR(cora:))) }")),
        )  # fmt: skip
    return Result(rows, ("the thesis draws the classes and gives no counts",))


def task_properties(setting: Setting) -> Result:
    """What a task has: agent, interval, motion, manipulation (Fig. 16)."""
    text = "SELECT DISTINCT ?p WHERE { ?p rdfs:domain rt:Task FILTER STRSTARTS(STR(?p), STR(rt:)) }"
    with rtask.open(":memory:") as kb:
        answer = list(kb.select(prologue(terms.PREFIXES) + text))
    names = sorted(str(row["p"]).strip("<>").replace("#", "/").rsplit("/", 1)[-1] for row in answer)
    return Result(
        (Compared("properties whose domain is a task", float(len(names))),),
        (
            "the thesis's task has an agent, an interval, a motion and a manipulation",
            f"ours: {', '.join(names)}",
        ),
    )


def learners(setting: Setting) -> Result:
    """Learners of the table in one world: returns by episode, and time for an action."""
    bins = TwoRooms.bins()
    makers: dict[str, Callable[[int], Any]] = {
        "TEXPLORE": lambda s: Texplore(bins, 4, seed=s),
        "R-MAX": lambda s: RMax(bins, 4, seed=s),
        "Dyna": lambda s: Dyna(bins, 4, seed=s),
        "Sarsa": lambda s: Sarsa(bins, 4, seed=s),
        "Q-learning": lambda s: QLearning(bins, 4, seed=s),
    }
    lives = setting.size(20, 3)
    episodes = 20
    rows, curves = [], {}
    for name, make in makers.items():
        returns, steps = [], 0
        began = time.process_time()
        for seed in range(setting.seed, setting.seed + lives):
            world = TwoRooms()
            world.reset(seed=1000 + seed)
            life = run_episodes(make(seed), world, episodes, seed=seed)
            returns.append([episode.reward for episode in life])
            steps += sum(episode.steps for episode in life)
        spent = time.process_time() - began
        curves[name] = np.mean(returns, axis=0)
        late = float(np.mean([life[10:] for life in returns]))
        rows.append(Compared(f"{name}: mean return of episodes 11 to 20", late))
        rows.append(Compared(f"{name}: time for an action", 1e3 * spent / max(steps, 1), unit="ms"))
    low = float(min(c.min() for c in curves.values()))
    chart = curve_chart(np.arange(1, episodes + 1), curves, "Two rooms", "episode", (low, 0.0),
                        "return")  # fmt: skip
    return Result(
        tuple(rows),
        (
            "the table says yes or no for 18 methods, of which five are built; more episodes are "
            "learned from where less samples are needed, and an action within .1 s is real time",
            "delay of actuators, which the table promises of TEXPLORE, is not built",
            *setting.shrunk("lives of each", 20, lives),
        ),
        {"returns": chart},
    )


def candidates(setting: Setting) -> Result:
    """Grasp candidates on the cloud of one view (AGILE's output in the thesis)."""
    view = next(iter(turned("bottle-5", 90, setting.seed)))
    inside = view.frame.object_mask() & (finite_depth(view.frame.depth_m) > 0)
    points = view.frame.points()[inside].astype(np.float64)
    plan_on_cloud(points, nao_hand(), viewpoints=np.zeros((1, 3)))  # compiles first
    began = time.process_time()
    proposals = plan_on_cloud(points, nao_hand(), viewpoints=np.zeros((1, 3)))
    spent = time.process_time() - began
    return Result(
        (
            Compared("candidates for the Nao's hand on a bottle", float(len(proposals))),
            Compared("time to plan them", spent, unit="s"),
        ),
        (STAND_INS, "the thesis shows a picture and gives no figures"),
    )


def object_state(setting: Setting) -> Result:
    """The state of an object: SIFT of its view, reduced to five numbers (Fig. 23)."""
    components = GrowingComponents()
    picture: bytes | None = None
    values = None
    for name in ("box-3", "bottle-5", "can-8", "box-11", "can-21"):
        for view in turned(name, 90, setting.seed):
            described, has_keypoints = pooled(view.described().descriptors)
            if has_keypoints:
                components.add(described)
                values = components.state(described)
            assert view.frame.rgb is not None  # of a simulated camera
            if picture is None:
                picture = png(view.frame.rgb)
    assert values is not None  # products have keypoints
    assert picture is not None  # and views
    return Result(
        (counted("numbers of the state", float(len(values.features)), 5.0),),
        (STAND_INS,),
        {"a view": picture},
    )
