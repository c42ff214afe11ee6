"""The model module of Gatto 2016: Figures 15, 16, 22 and 23."""

from __future__ import annotations

import time

import numpy as np

import ontology as terms
import rtask
from features.geometry import finite_depth
from grasp.learning.state import GrowingComponents, pooled
from grasp.spatial.grasp_plan import plan_on_cloud
from grasp.spatial.gripper import nao_hand
from rtask.rdf.terms import prologue
from simulate.thesis.materials.pictures import png
from simulate.thesis.materials.products import STAND_INS, turned
from simulate.thesis.result import Compared, Result, Setting, counted

__all__ = ["candidates", "object_state", "ontology", "task_properties"]


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
