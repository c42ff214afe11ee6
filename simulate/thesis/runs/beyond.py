"""What neither thesis has, one figure or a few for each: ours alone."""

from __future__ import annotations

from collections import deque

import numpy as np
from pyoxigraph import NamedNode

import ontology as terms
import rtask
from reasoner import Proof
from rtask.errors import ForbiddenError, InconsistentError
from rtask.rdf.terms import prologue
from simulate.fleet.sharing import sharing_study, summarise_sharing
from simulate.study.day.command import summary_of as summary_of_days
from simulate.study.declaration import Study
from simulate.study.quality.promised import promise_figures
from simulate.study.quality.report import quality_study
from simulate.study.tasks.command import summary_of
from simulate.study.tasks.trial import EVENTS, lab_update
from simulate.thesis.result import Compared, Result, Setting, share_of

__all__ = ["inference", "lessons", "places", "plans", "promises", "rights"]

_BASE = "https://example.org/kb/"
_STREAM = 91

_AXIOMS = (
    "rt:Mug owl:disjointWith rt:ManipulableObject",
    "rt:Mug rdfs:subClassOf owl:Nothing",
    "rt:hasOutcome a owl:IrreflexiveProperty",
    "rdfs:subClassOf a owl:SymmetricProperty",
    "rdf:type rdfs:subPropertyOf my:p",
    "my:p rdfs:subPropertyOf owl:sameAs",
    "my:Mug owl:equivalentClass rt:Mug",
    "its:mug owl:sameAs my:mug",
    "its:mug a owl:Nothing",
    "[] a owl:AllDifferent ; owl:distinctMembers (its:mug its:bowl)",
)
"""Statements that could make another robot's facts illegal, or its terms mean other things."""


_VALUES = (
    ("<robot/nao-2>", "rt:serialNumber", "'0000'", "'A17'"),
    ("its:mug", "rt:mass", "9.0e0", "0.2e0"),
    ("its:mug", "rt:graspWidth", "9.0e0", "0.06e0"),
)
"""Things of another robot: a property with one value, a false one, and the owner's."""


def inference(setting: Setting) -> Result:
    """Statements that follow in a lab, each with a proof down to what somebody stated."""
    things = setting.size(200, 20)
    asked = setting.size(1000, 150)
    rng = np.random.default_rng([setting.seed, _STREAM])
    with rtask.open(":memory:", base=_BASE) as kb:
        before = _inferred(kb)
        stated = kb.update(lab_update(rng, things)).added
        derived = sorted(_inferred(kb) - before, key=str)
        chosen = [derived[i] for i in rng.permutation(len(derived))[:asked]]
        proofs = [kb.explain(*triple) for triple in chosen]
        proved = [proof for proof in proofs if isinstance(proof, Proof) and _is_grounded(proof)]
    depths = [_depth(proof) for proof in proved]
    return Result(
        (
            Compared(f"statements stated of a lab with {things} things", float(stated)),
            Compared("statements that follow", float(len(derived))),
            share_of("of those drawn, with a proof down to stated ones", len(proved), len(proofs)),
            Compared("steps of the longest proof", float(max(depths, default=0))),
        ),
        (f"{len(proofs)} of the derived statements were drawn and explained",),
    )  # fmt: skip


def _inferred(kb: rtask.KnowledgeBase) -> set[tuple[NamedNode, NamedNode, object]]:
    quads = kb.store.quads_for_pattern(None, None, None, kb.graphs.inferred)
    return {
        (quad.subject, quad.predicate, quad.object)
        for quad in quads
        if isinstance(quad.subject, NamedNode) and str(quad.subject.value).startswith(_BASE)
    }


def _is_grounded(proof: Proof) -> bool:
    """Whether every leaf is stated by somebody, in a graph that the proof names."""
    left = deque([proof])
    while left:
        step = left.popleft()
        if not step.premises and step.rule == "asserted" and not step.graphs:
            return False
        left.extend(step.premises)
    return True


def _depth(proof: Proof) -> int:
    return 1 + max((_depth(premise) for premise in proof.premises), default=0)


def rights(setting: Setting) -> Result:
    """Axioms by which one robot could stop the others: refused; what the others state: stored."""
    prefixes = prologue(terms.PREFIXES)
    own, others = f"PREFIX my: <{_BASE}robot/nao-1/> ", f"PREFIX its: <{_BASE}robot/nao-2/> "
    refused = stored = 0
    with rtask.open(":memory:", base=_BASE) as kb:
        kb.update(prefixes + others + "INSERT DATA { its:mug a rt:Mug . its:bowl a rt:Cup }",
                  agent="nao-2")  # fmt: skip
        for number, axiom in enumerate(_AXIOMS):
            try:
                kb.update(f"{prefixes}{own}{others}INSERT DATA {{ {axiom} }}", agent="nao-1")
            except ForbiddenError:
                refused += 1
            fact = f"its:mug-{number} a rt:Mug ; rdfs:label 'mug {number}'"
            stored += bool(
                kb.update(f"{prefixes}{others}INSERT DATA {{ {fact} }}", agent="nao-2").added
            )
        kept = 0
        for thing, name, false, true in _VALUES:
            for agent, value in (("nao-1", false), ("nao-2", true)):
                try:
                    text = (
                        f"BASE <{_BASE}> {prefixes}{others}INSERT DATA {{ {thing} {name} {value} }}"
                    )
                    is_stored = bool(kb.update(text, agent=agent).added)
                except (ForbiddenError, InconsistentError):
                    is_stored = False
            kept += is_stored
        changed = list(
            kb.select(
                f"{prefixes}{others}SELECT ?thing WHERE {{ VALUES ?thing {{ its:mug its:bowl }} "
                "{ ?thing owl:sameAs ?x FILTER(?x != ?thing) } UNION { ?thing a owl:Nothing } }"
            )
        )
    return Result(
        (
            share_of("axioms of one robot about terms of others, refused", refused, len(_AXIOMS)),
            share_of("facts of another robot after each, stored", stored, len(_AXIOMS)),
            Compared("things of the other robot that changed", float(len(changed))),
            share_of(
                "its own values, stored although a robot had stated a false one before it",
                kept,
                len(_VALUES),
            ),
        ),
        (
            "a robot may state facts, and axioms about terms of its own that nobody else uses",
            "where the last share is below 1, whoever speaks first of a value can stop its owner",
        ),
    )


def lessons(setting: Setting) -> Result:
    """Attempts that a Panda needs for things that a Nao tried first, with its graph and without."""
    fleets, things = setting.size(5, 1), setting.size(20, 4)
    study = sharing_study(fleets, 2, things, 4, setting.seed, True, "fast", "fragile",
                          ("nao", "panda"))  # fmt: skip
    gain = summarise_sharing(setting.trials(study), study.settings["max_attempts"])[
        "shared_less_not_shared"
    ]
    change = gain["common"]["attempts"]
    interval = change["interval95"] and tuple(change["interval95"])
    return Result(
        (
            Compared("attempts for a thing with the Nao's lessons less those without",
                     change["mean"], interval=interval),
        ),
        (
            f"{fleets} fleets of a Nao, then a Panda; {things} things each, half of them common",
            *setting.shrunk("things", 20, things),
        ),
    )  # fmt: skip


def promises(setting: Setting) -> Result:
    """Chance promised of a first grasp, beside the share that held, by quarters of the promise."""
    objects, draws = setting.size(90, 16), 4
    study = quality_study(objects, draws, setting.seed, alone=True)
    results = setting.trials(study)
    rows = []
    for hand in dict.fromkeys(str(result["hand"]) for result in results):
        figures = promise_figures([r for r in results if r["hand"] == hand], "held", "lift")
        for name, part in (
            ("lowest", figures["quarters"][0]),
            ("highest", figures["quarters"][-1]),
        ):
            rows += [
                Compared(f"{hand}, {name} quarter: chance promised", part["promised"]),
                Compared(f"{hand}, {name} quarter: share held", part["held"]),
            ]
    return Result(
        tuple(rows),
        (
            f"{objects} generated objects a hand, {draws} draws of noise each; "
            "`rtask study grasp-quality` has intervals and all quarters",
        ),
    )


def plans(setting: Setting) -> Result:
    """Goals in words that are reached although something comes between."""
    goals = setting.size(100, 12)
    settings = {"seed": setting.seed, "things": 6, "slip": 0.1, "events": list(EVENTS)}
    study = Study("goals", "simulate.study.tasks.trial:run_trial", settings, goals)
    summary = summary_of(setting.trials(study))
    return Result(
        (
            share_of("goals reached of those that could be", summary["reached"],
                     summary["possible"]),
            Compared("things lost from the graph's memory", float(summary["lost"])),
            Compared("picks stored twice", float(summary["twice"])),
        ),
        (
            f"{goals} goals for two Naos and two Pandas at two tables, without dynamics; each time "
            "one event: a thing is moved, falls or is taken away, a person says no, or a program "
            "is killed",
        ),
    )  # fmt: skip


def places(setting: Setting) -> Result:
    """Questions about a day in the lab: where, when, who moved it, which of two equal things."""
    hours, things = setting.size(8, 1), setting.size(30, 12)
    questions, samples = setting.size(1000, 150), setting.size(12_000, 300)
    settings = {
        "seed": setting.seed, "hours": float(hours), "things": things,
        "questions": questions, "samples": samples,
    }  # fmt: skip
    study = Study("one day", "simulate.study.day.trial:run_trial", settings, 1)
    day = summary_of_days(setting.trials(study))
    within = day["calibration"]["all"]
    counted = {
        verdict: sum(counts[verdict] for counts in day["verdicts"].values())
        for verdict in ("right", "not known", "wrong")
    }
    return Result(
        (
            *(share_of(f"answers that were {verdict}", count, day["questions"])
              for verdict, count in counted.items()),
            share_of("things within the distance that was said with 90 %", within["within"],
                     within["samples"]),
            Compared("things in two places at one instant", float(day["two_places"])),
            share_of("named things that a new robot found at first look",
                     day["found_at_first_look"], day["looked_for"]),
        ),
        (
            f"one day of {hours} h with {things} things and three robots, without dynamics; robots "
            "and people move, lose, swap, cover and box things, and what truly happened is kept "
            "apart and judges the answers",
        ),
    )  # fmt: skip
