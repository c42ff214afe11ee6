"""The ontology of the house with its rules and sample: what is derived, in any order of commits."""

from __future__ import annotations

import random
import re
import subprocess
import sys
from pathlib import Path

import pyoxigraph as ox
import pytest
from pyoxigraph import NamedNode

import ontology
from reasoner import Closure
from reasoner.dl.profile import check_profile

TYPE = NamedNode("http://www.w3.org/1999/02/22-rdf-syntax-ns#type")


def load(*paths) -> list:
    store = ox.Store()
    for path in paths:
        store.load(path=str(path))
    return [(q.subject, q.predicate, q.object) for q in store]


@pytest.fixture(scope="module")
def schema() -> list:
    return load(*ontology.modules())


@pytest.fixture(scope="module")
def sample() -> list:
    return sorted(set(load(ontology.path("examples/sample.trig"))), key=str)


@pytest.fixture(scope="module")
def rules() -> list[str]:
    return [path.read_text() for path in ontology.rules()]


@pytest.fixture(scope="module")
def closure(schema, sample, rules) -> Closure:
    return Closure.build(schema, sample, rules)


def rt(name: str) -> NamedNode:
    return NamedNode(ontology.NS + name)


def names(closure: Closure, p: NamedNode, o: NamedNode | None = None) -> list[str]:
    return sorted(
        " ".join(x.value.rsplit("/", 1)[-1] for x in (s, v) if x != o)
        for s, _, v in closure.match(None, p, o)
    )


def test_the_sample_is_consistent(closure):
    assert closure.contradictions() == []
    assert closure.stats()["problems"] == []


@pytest.mark.parametrize(
    ("name", "members"),
    [
        ("ManipulatorRobot", ["nao", "pr2"]),
        ("DrinkingVessel", ["mug", "mug2"]),
        ("ProvenGrasp", ["g1", "g2"]),
    ],
)
def test_classes_are_recognised(closure, name, members):
    assert names(closure, TYPE, rt(name)) == members


@pytest.mark.parametrize(
    ("name", "pairs"),
    [
        ("canGrasp", ["nao pen", "pr2 mug", "pr2 mug2", "pr2 pen"]),
        ("currentPose", ["mug p1"]),
        ("overlapsInTime", ["t1 t2", "t2 t1"]),
        ("knownBy", ["mug pr2", "mug2 pr2"]),
        ("judgedSuccess", ["o1 true", "o2 false", "o3 false", "o4 true", "o5 false"]),
    ],
)
def test_properties_are_derived(closure, name, pairs):
    assert names(closure, rt(name)) == pairs


@pytest.mark.slow
def test_every_inferred_triple_of_the_sample_has_a_proof(closure):
    for triple in closure.inferred():
        proof = closure.explain(triple, budget=10_000_000)
        assert proof.holds
        assert not proof.is_asserted


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_commits_in_any_order_and_size_give_the_same(schema, sample, rules, closure, seed):
    chance = random.Random(seed)
    order = sample[:]
    chance.shuffle(order)
    grown = Closure.build(schema, [], rules)
    inferred = set(grown.inferred())
    start = set(inferred)
    while order:
        size = chance.choice([1, 5, 25, 120])
        batch, order = order[:size], order[size:]
        staged = grown.stage(add=batch)
        inferred = (inferred - set(staged.inferred_removed)) | set(staged.inferred_added)
        staged.apply()
    assert inferred == set(grown.inferred()) == set(closure.inferred())
    order = sample[:]
    chance.shuffle(order)
    for i in range(0, len(order), 40):
        staged = grown.stage(remove=order[i : i + 40])
        inferred = (inferred - set(staged.inferred_removed)) | set(staged.inferred_added)
        staged.apply()
    assert inferred == set(grown.inferred()) == start


def test_a_persons_verdict_counts_and_without_the_person_physics_does(schema, sample, rules):
    closure = Closure.build(schema, sample, rules)
    (person,) = [s for s, _, _ in closure.match(None, TYPE, rt("HumanFeedback"))]
    ((outcome, _, _),) = closure.match(None, rt("hasFeedback"), person)
    judged = closure.match(outcome, rt("judgedSuccess"))
    physics = closure.match(outcome, rt("success"))
    assert judged[0][2] != physics[0][2]
    staged = closure.stage(remove=[(outcome, rt("hasFeedback"), person)])
    assert judged[0] in staged.inferred_removed
    assert (outcome, rt("judgedSuccess"), physics[0][2]) in staged.inferred_added


@pytest.mark.parametrize(
    ("planted", "rule"),
    [
        (("t1", "Action"), "cax-adc"),
        (("g1", "PlanarGrasp"), "cax-dw"),
        (("pr2", "Human"), "cax-dw"),
    ],
)
def test_planted_clashes_are_found(closure, sample, planted, rule):
    name, c = planted
    subject = next(s for s, _, _ in sample if s.value.endswith("/" + name))
    staged = closure.stage(add=[(subject, TYPE, rt(c))])
    assert rule in {clash.rule for clash in staged.contradictions}
    assert any(subject in t for clash in staged.contradictions for t in clash.triples)
    staged.discard()


def test_own_modules_are_within_the_profile():
    own = [path for path in ontology.modules() if path.parent.name != "cora"]
    assert check_profile(load(*own)) == []


def test_the_axioms_outside_of_the_profile_are_the_known_ones(schema):
    found = sorted(
        f"{v.construct} in {v.position}: {re.sub('_:[0-9a-f]+', '_:', v.axiom)}"
        for v in check_profile(schema)
    )
    known = (Path(__file__).parent / "outside_owl2rl.txt").read_text("utf-8").splitlines()
    assert found == [line for line in known if line and not line.startswith("#")]


def test_importing_the_room_is_quick_and_light():
    code = (
        "import sys, reasoner\n"
        "heavy = {'rdflib', 'pyparsing', 'numba', 'scipy', 'owlready2', 'pyshacl'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
