"""The object layer, raw pyoxigraph and owlready2 on the same work, interleaved.

    python tests/benchmarks/kb/bench_model.py
    python tests/benchmarks/kb/bench_model.py --objects 2000 --rounds 7

One shelf of objects, each with a view and grasps that were evaluated, in memory. All sides
answer the same questions about it; the answers are compared before the times are printed. The
target of the first two rows is a ratio to raw pyoxigraph below 3.
"""

from __future__ import annotations

import argparse
import gc
import os
import random
import statistics
import time
from collections.abc import Callable
from typing import Any

import pyoxigraph as ox

import ontology
import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK, avg, count

RT = ontology.NS
TYPE = ox.NamedNode(ontology.PREFIXES["rdf"] + "type")
PREFIX = f"PREFIX rt: <{RT}> "
Thing = RTASK.Mug
Side = Callable[[], Any]


def shelf(objects: int) -> list[ox.Quad]:
    """Return objects with 7 statements, 1 view of 3, and 3 grasps of 4 with evaluations of 3."""
    quads: list[ox.Quad] = []

    def say(subject: str, kind: str, **values: Any) -> None:
        quads.append(ox.Quad(ox.NamedNode(subject), TYPE, ox.NamedNode(RT + kind)))
        for name, value in values.items():
            for one in value if isinstance(value, list) else [value]:
                term = ox.NamedNode(one[1:]) if str(one).startswith("^") else ox.Literal(one)
                quads.append(ox.Quad(ox.NamedNode(subject), ox.NamedNode(RT + name), term))

    dice = random.Random(7)
    for n in range(objects):
        thing, grasps = f"urn:o:{n}", [f"urn:g:{n}:{k}" for k in range(3)]
        say(thing, "Mug", objectId=f"lab/m-{n}", name=f"mug {n}", mass=dice.random(),
            graspWidth=dice.random(), surfaceMaterial=dice.choice(["wood", "tin", "glass"]),
            hasView=f"^urn:v:{n}", hasGrasp=["^" + grasp for grasp in grasps])  # fmt: skip
        say(f"urn:v:{n}", "View", name="front", viewContent=f"^urn:i:{n}")
        for grasp in grasps:
            say(grasp, "PlanarGrasp", gripperType="nao_hand", graspQuality=dice.random(),
                hasEvaluation="^" + grasp + ":e")  # fmt: skip
            say(grasp + ":e", "GraspEvaluation", graspConfidence=dice.random(), sampleCount=100)
    return quads


class Work:
    """The questions, each answered by three sides."""

    def __init__(self, objects: int) -> None:
        self.objects = objects
        quads = shelf(objects)
        self.kb: KnowledgeBase = rtask.open(":memory:", reason=False)
        with self.kb.transaction() as tx:
            tx.add_quads(quads)
        self.raw = ox.Store()
        self.raw.extend([ox.Quad(q.subject, q.predicate, q.object) for q in quads])
        self.world = self.kb.owlready()
        self.names = [f"urn:o:{n}" for n in random.Random(1).sample(range(objects), objects)]
        with self.kb.session(inferred=True) as s:
            self.prefetch = self._prefetched(s).sparql()

    # One object by its IRI, six of its values

    def get_ours(self) -> float:
        with self.kb.session(inferred=True) as s:
            return sum(s.get(RTASK.Mug, name).mass or 0.0 for name in self.names)

    def get_raw(self) -> float:
        total = 0.0
        for name in self.names:
            found: dict[str, list[Any]] = {}
            for p, o in self.raw.query(f"SELECT ?p ?o {{ <{name}> ?p ?o }}"):
                found.setdefault(p.value, []).append(o)
            total += float(found[RT + "mass"][0].value)
        return total

    def get_owlready(self) -> float:
        self.world._entities.clear()  # its identity map, else it answers from memory
        return float(sum(self.world[name].mass[0] for name in self.names))

    # 1,000 objects with views, grasps and evaluations

    @staticmethod
    def _prefetched(session: Any) -> Any:
        return session.query(Thing).prefetch(
            Thing.has_view, Thing.has_grasp, Thing.has_grasp.has_evaluation
        )

    def prefetch_ours(self) -> float:
        with self.kb.session(inferred=True) as s:
            return sum(
                evaluation.grasp_confidence or 0.0
                for thing in self._prefetched(s)
                for grasp in thing.has_grasp
                for evaluation in grasp.has_evaluation
            )

    def prefetch_raw(self) -> float:
        facts: dict[str, dict[str, list[Any]]] = {}
        for _, subject, predicate, value in self.raw.query(self.prefetch):
            facts.setdefault(subject.value, {}).setdefault(predicate.value, []).append(value)
        key = RT + "graspConfidence"
        return sum(float(found[key][0].value) for found in facts.values() if key in found)

    def prefetch_owlready(self) -> float:
        self.world._entities.clear()
        return float(
            sum(
                evaluation.graspConfidence
                for thing in self.world[RT + "Mug"].instances()
                for grasp in thing.hasGrasp
                for evaluation in grasp.hasEvaluation
            )
        )

    # A filter over a path, sorted, the ten best

    def best_ours(self) -> list[str]:
        with self.kb.session(inferred=True) as s:
            grasps = RTASK.GraspConfiguration
            plan = s.query(RTASK.PlanarGrasp).where(grasps.grasp_quality > 0.9)
            return [str(g.iri) for g in plan.order_by(-grasps.grasp_quality).limit(10)]

    def best_raw(self) -> list[str]:
        text = "SELECT ?g { ?g a rt:PlanarGrasp ; rt:graspQuality ?q FILTER(?q > 0.9) }"
        return [
            row[0].value for row in self.raw.query(f"{PREFIX}{text} ORDER BY DESC(?q) LIMIT 10")
        ]

    def best_owlready(self) -> list[str]:
        self.world._entities.clear()
        grasps = [g for g in self.world[RT + "PlanarGrasp"].instances() if g.graspQuality > 0.9]
        return [g.iri for g in sorted(grasps, key=lambda g: -g.graspQuality)[:10]]

    # Numbers about groups

    def group_ours(self) -> list[tuple[str, int]]:
        with self.kb.session(inferred=True) as s:
            rows = s.query(Thing).group_by(Thing.surface_material)
            found = rows.aggregate(n=count(), mean=avg(Thing.mass))
            return sorted((row["surface_material"], row["n"]) for row in found)

    def group_raw(self) -> list[tuple[str, int]]:
        text = (
            "SELECT ?m (COUNT(?o) AS ?n) (AVG(?w) AS ?a)"
            " { ?o a rt:Mug ; rt:surfaceMaterial ?m ; rt:mass ?w } GROUP BY ?m"
        )
        rows = self.raw.query(PREFIX + text)
        return sorted((row["m"].value, int(row["n"].value)) for row in rows)

    def group_owlready(self) -> list[tuple[str, int]]:
        self.world._entities.clear()
        groups: dict[str, list[float]] = {}
        for thing in self.world[RT + "Mug"].instances():
            groups.setdefault(thing.surfaceMaterial[0], []).append(thing.mass[0])
        return sorted((name, len(listed)) for name, listed in groups.items())


QUESTIONS = {
    "an object by its IRI": "get",
    "objects with 3 relations": "prefetch",
    "10 best of a filter": "best",
    "numbers about groups": "group",
}


def measure(work: Work, rounds: int) -> None:
    """Print a table: the median CPU time of each side, and the ratios of medians."""
    sides = ("ours", "raw", "owlready")
    print(f"{'':28s}" + "".join(f"{s:>12s}" for s in (*sides, "/ raw", "/ owlready")))
    for title, name in QUESTIONS.items():
        ask: dict[str, Side] = {side: getattr(work, f"{name}_{side}") for side in sides}
        answers = {side: _rounded(do()) for side, do in ask.items()}
        assert len({repr(a) for a in answers.values()}) == 1, (title, answers)
        times: dict[str, list[float]] = {side: [] for side in sides}
        for _ in range(rounds):
            for side, do in ask.items():
                gc.collect()
                start = time.process_time()
                do()
                times[side].append(time.process_time() - start)
        middle = {side: statistics.median(times[side]) * 1e3 for side in sides}
        shown = "".join(f"{middle[side]:9.1f} ms" for side in sides)
        by_raw, by_owlready = (middle["ours"] / middle[side] for side in sides[1:])
        print(f"{title:28s}{shown}{by_raw:12.2f}{by_owlready:12.2f}")


def _rounded(answer: Any) -> Any:
    return round(answer, 6) if isinstance(answer, float) else answer


def main() -> None:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    work = Work(options.objects)
    print(f"{options.objects} objects, {len(work.raw)} statements, load {os.getloadavg()[0]:.1f}")
    measure(work, options.rounds)
    print(f"load {os.getloadavg()[0]:.1f}")
    work.kb.close()


if __name__ == "__main__":
    main()
