"""A shared key makes nothing one across the names of several owners, in whatever order."""

import itertools
import random

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode

from reasoner import Closure, Config

RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
OWL = "http://www.w3.org/2002/07/owl#"
TYPE, SAME = NamedNode(RDF + "type"), NamedNode(OWL + "sameAs")
KEYED, SERIAL, BADGE = (NamedNode(f"urn:{name}") for name in ("Keyed", "serial", "badge"))
CELL = BlankNode("cell")
SCHEMA = [
    (KEYED, NamedNode(OWL + "hasKey"), CELL),
    (CELL, NamedNode(RDF + "first"), SERIAL),
    (CELL, NamedNode(RDF + "rest"), NamedNode(RDF + "nil")),
    (BADGE, TYPE, NamedNode(OWL + "InverseFunctionalProperty")),
]


def owner(iri):
    """Return the first letter of names such as `urn:a:1`; names such as `urn:x` are nobody's."""
    return iri[4] if iri[5:6] == ":" else None


def name(text):
    return NamedNode(f"urn:{text}")


def same(closure):
    return {(s.value, o.value) for s, p, o in closure.inferred() if p == SAME and s.value < o.value}


def world(dice):
    """Return facts about things of two owners and of nobody that share keys, some stated equal."""
    things = [name(f"{letter}:{n}") for letter in "ab" for n in range(4)] + [name("x"), name("y")]
    facts = [(thing, TYPE, KEYED) for thing in things]
    for thing in things:
        if dice.random() < 0.5:
            facts.append((thing, SERIAL, Literal(str(dice.randrange(3)))))
        if dice.random() < 0.3:
            facts.append((thing, BADGE, name(f"badge{dice.randrange(3)}")))
    stated = dice.sample([*itertools.combinations(things, 2)], dice.randrange(4))
    return facts, [(s, SAME, o) for s, o in stated]


def test_a_key_tells_among_the_names_of_one_owner_only():
    keyed = [name(text) for text in ("a:1", "a:2", "b:1", "x", "y")]
    facts = [(thing, p, o) for thing in keyed for p, o in ((TYPE, KEYED), (SERIAL, Literal("1")))]
    apart = Closure.build(SCHEMA, facts, config=Config(owner=owner))
    assert same(apart) == {("urn:a:1", "urn:a:2"), ("urn:x", "urn:y")}
    assert len(same(Closure.build(SCHEMA, facts))) == 10
    apart.stage(add=[(name("a:2"), SAME, name("x"))]).apply()
    assert len(apart.same_as(name("y"))) == 4  # two names of a, and two of nobody


@pytest.mark.parametrize("bulk_from", [1, 2_000])
@pytest.mark.parametrize("stated", [("a:1", "b:1"), ("a:9", "b:2")])
def test_a_class_that_gains_an_owner_is_looked_at_again(bulk_from, stated):
    """Whichever name represents the class, and whether or not that adds a fact about it."""
    keyed = [(name("a:1"), "1"), (name("b:2"), "1"), (name("b:3"), "1"), (name("b:4"), "2")]
    facts = [(thing, SERIAL, Literal(value)) for thing, value in keyed]
    facts += [(name(text), TYPE, KEYED) for text in ("a:1", "a:9", "b:1", "b:2", "b:3", "b:4")]
    config = Config(owner=owner, bulk_from=bulk_from)
    identity = (name(stated[0]), SAME, name(stated[1]))
    later = Closure.build(SCHEMA, facts, config=config)
    assert same(later) == {("urn:b:2", "urn:b:3")}
    later.stage(add=[identity]).apply()
    assert len(later.same_as(name("b:2"))) == 4
    whole = Closure.build(SCHEMA, [*facts, identity], config=config)
    assert whole.digest() == later.digest()


@pytest.mark.parametrize("seed", range(12))
def test_columns_single_facts_and_retractions_agree(seed):
    dice = random.Random(seed)
    facts, stated = world(dice)
    bulk = Closure.build(SCHEMA, [*facts, *stated], config=Config(owner=owner, bulk_from=1))
    single = Closure.build(SCHEMA, [], config=Config(owner=owner))
    order = [*facts, *stated]
    dice.shuffle(order)
    for fact in order:
        single.stage(add=[fact]).apply()
    assert bulk.digest() == single.digest()
    for fact in stated:
        single.stage(remove=[fact]).apply()
    plain = Closure.build(SCHEMA, facts, config=Config(owner=owner))
    assert plain.digest() == single.digest()
    assert all(owner(a) == owner(b) for a, b in same(plain))
