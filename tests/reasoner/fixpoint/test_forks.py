"""Forks: a closure beside another holds what its own statements entail."""

from __future__ import annotations

import random

import pytest

from reasoner import Closure, Fork
from tests.reasoner.ttl import triple, triples

SCHEMA = """:Mug rdfs:subClassOf :Vessel . :Vessel rdfs:subClassOf :Thing .
:Mug owl:disjointWith :Pen . :in a owl:TransitiveProperty .
:on rdfs:domain :Thing ; rdfs:range :Place . :same a owl:FunctionalProperty ."""
MORE = ":Place rdfs:subClassOf :Room ."


def fork_of(trunk: Closure, add=(), remove=()) -> Fork:
    fork = Fork.of(trunk, trunk.stage(add, remove))
    assert fork is not None
    return fork


def facts(closure: Closure) -> set[str]:
    return set(map(str, closure.inferred()))


def test_what_a_fork_takes_stays_in_it():
    trunk = Closure.build(triples(SCHEMA), triples(":a a :Mug ."))
    before = facts(trunk)
    fork = fork_of(trunk, triples(":b a :Mug ."))
    fork.stage(add=triples(":c a :Mug ."), remove=triples(":a a :Mug .")).apply()
    assert fork.contains(triple(":b a :Vessel"))
    assert fork.contains(triple(":c a :Thing"))
    assert not fork.contains(triple(":a a :Thing"))
    assert facts(trunk) == before
    assert not trunk.contains(triple(":b a :Mug"))


def test_what_the_trunk_takes_does_not_show_in_a_fork():
    trunk = Closure.build(triples(SCHEMA), triples(":a a :Mug . :x :in :y ."))
    fork = fork_of(trunk, triples(":y :in :z ."))
    held = facts(fork)
    trunk.stage(add=triples(":z :in :w . :y :in :z ."), remove=triples(":a a :Mug .")).apply()
    assert not fork.is_lost
    assert facts(fork) == held
    assert fork.contains(triple(":x :in :z"))
    assert not fork.contains(triple(":x :in :w"))
    trunk.stage(remove=triples(":y :in :z . :x :in :y .")).apply()
    assert facts(fork) == held


def test_a_trunk_that_derives_everything_anew_loses_its_forks():
    trunk = Closure.build(triples(SCHEMA), triples(":a a :Mug ."))
    fork = fork_of(trunk, triples(":b a :Mug ."))
    trunk.stage(remove=triples(":Vessel rdfs:subClassOf :Thing .")).apply()
    assert fork.is_lost


def test_contradictions_of_a_change_of_a_fork_are_found_and_none_of_the_trunk():
    trunk = Closure.build(triples(SCHEMA), triples(":a a :Mug ."))
    fork = fork_of(trunk, triples(":b a :Mug ."))
    trunk.stage(add=triples(":b a :Pen .")).apply()
    assert not trunk.contradictions()
    staged = fork.stage(add=triples(":b a :Pen ."))
    assert staged.contradictions
    staged.discard()
    assert not fork.contradictions()


@pytest.mark.parametrize("seed", [1, 2, pytest.param(3, marks=pytest.mark.deep)])
def test_a_fork_holds_what_a_closure_of_its_own_would(seed):
    """Random changes on both sides, equal individuals, withdrawn and new axioms among them."""
    draw = random.Random(seed)
    names = [f":n{k}" for k in range(7)]
    trunk_told = set(triples(SCHEMA + " :n0 a :Mug . :n1 :in :n2 ."))
    trunk = Closure.build(trunk_told, [])
    fork, fork_told = fork_of(trunk), set(trunk_told)

    def statement():
        kind = draw.choice(["a", ":in", ":on", ":same", "owl:sameAs"])
        value = draw.choice([":Mug", ":Vessel"]) if kind == "a" else draw.choice(names)
        return triple(f"{draw.choice(names)} {kind} {value}")

    for step in range(60):
        is_fork = draw.random() < 0.6
        closure, told = (fork, fork_told) if is_fork else (trunk, trunk_told)
        gone = draw.sample(sorted(told - set(triples(SCHEMA)), key=str), min(2, len(told) - 8))
        come = [statement() for _ in range(draw.randint(1, 3))]
        if step == 20:
            come += triples(MORE)
        if step == 40:
            gone += triples(MORE)
        come = [t for t in come if t not in told]
        gone = [t for t in gone if t in told and t not in come]
        closure.stage(come, gone).apply()
        told.difference_update(gone)
        told.update(come)
        if fork.is_lost:
            fork = fork_of(trunk, fork_told - trunk_told, trunk_told - fork_told)
        if step % 4 == 0:
            assert facts(fork) == facts(Closure.build(fork_told, []))
            assert facts(trunk) == facts(Closure.build(trunk_told, []))
            assert fork.size == len(fork_told)
