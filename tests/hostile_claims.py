"""Hostile writes of a robot without the right to axioms: claims about names and things of others.

Beside :mod:`tests.hostile_writes`, which is about what follows from axioms. Each write is an update
over names of five other robots, some of which they have yet to use.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from itertools import pairwise

from tests.contested_names import BASE

PREFIXES = (
    "PREFIX rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> "
    "PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "
    "PREFIX owl: <http://www.w3.org/2002/07/owl#> "
    "PREFIX xsd: <http://www.w3.org/2001/XMLSchema#> "
    "PREFIX prov: <http://www.w3.org/ns/prov#> "
    "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
    "PREFIX cora: <http://purl.org/ieee1872-owl/cora-bare#> "
    "PREFIX sumo: <http://purl.org/ieee1872-owl/sumo-cora#> "
)
HOSTILE = "nao-0"
VICTIMS = ("nao-1", "nao-2", "nao-3", "nao-4", "nao-5")
THINGS = 24
"""Things of each robot that these writes may name."""
_CLASSES = (
    "rt:Grasp", "rt:PickAndPlace", "rt:Human", "cora:Robot", "sumo:Process", "sumo:Abstract",
    "sumo:Quantity", "rt:Image2D", "rt:PointCloud", "rt:Outcome", "rt:Bottle", "owl:Class",
)  # fmt: skip
_VALUES = (
    "rt:mass", "rt:serialNumber", "rt:sha256", "rt:atTime", "rt:widthPx", "rt:graspQuality",
    "rt:objectId", "rt:name", "rt:encoding", "rt:requestId",
)  # fmt: skip
_RELATIONS = (
    "rt:bestMatch", "rt:hasOutcome", "rt:graspPose", "rt:executesGrasp", "rt:evaluates",
    "rt:acquiredBy", "cora:equippedWith", "rt:hasFeature", "rt:ofJoint", "sumo:agent",
)  # fmt: skip


def _its(rng: random.Random) -> str:
    victim = rng.choice(VICTIMS)
    return f"<{BASE}robot/{victim}/thing{rng.randrange(THINGS)}>"


def _robot(rng: random.Random) -> str:
    return f"<{BASE}robot/{rng.choice(VICTIMS)}>"


def _my(name: object) -> str:
    return f"<{BASE}robot/{HOSTILE}/{name}>"


def _literal(rng: random.Random) -> str:
    return rng.choice(
        ("'fake'", "1", "-1e308", "'x'@en", "'2999-01-01T00:00:00Z'^^xsd:dateTime",
         "'NaN'^^xsd:double", "true", "'abc'^^xsd:integer")
    )  # fmt: skip


def _insert(statements: list[str], prefix: str = "") -> str:
    return f"{PREFIXES}INSERT DATA {{ {prefix} {' . '.join(statements)} {'}' if prefix else ''} }}"


def _each(rng: random.Random, statement: Callable[[], str], count: int = 6) -> str:
    return _insert([statement() for _ in range(count)])


def _own_schema(rng: random.Random) -> str:
    n, kind = rng.randrange(10**6), rng.choice(("range", "domain"))
    own, cls = _my(f"p{n}"), rng.choice(_CLASSES[:10])
    use = [f"{_my(i)} {own} {_its(rng)} . {_its(rng)} {own} {_my(i)}" for i in range(4)]
    return _insert([f"{own} rdfs:{kind} {cls}", *use])


def _two_parents(rng: random.Random) -> str:
    own = _my(f"C{rng.randrange(10**6)}")
    return _insert(
        [f"{own} rdfs:subClassOf sumo:Process", *(f"{_its(rng)} a {own}" for _ in range(6))]
    )


def _impossible_class(rng: random.Random) -> str:
    own = _my(f"N{rng.randrange(10**6)}")
    parents = [f"{own} rdfs:subClassOf sumo:Process, sumo:Object"]
    return _insert([*parents, f"{_its(rng)} a {own}"])


def _chain(rng: random.Random) -> str:
    own = _my(f"t{rng.randrange(10**6)}")
    things = [_its(rng) for _ in range(12)]
    links = [f"{a} {own} {b}" for a, b in pairwise(things)]
    return _insert([f"{own} a owl:TransitiveProperty ; rdfs:range rt:Grasp", *links])


def _irreflexive(rng: random.Random) -> str:
    own, kind = _my(f"i{rng.randrange(10**6)}"), rng.choice(("Asymmetric", "Irreflexive"))
    return _insert([f"{own} a owl:{kind}Property", f"{_its(rng)} {own} {_its(rng)}"])


def _below_shipped(rng: random.Random) -> str:
    own = _my(f"s{rng.randrange(10**6)}")
    below = f"{own} rdfs:subPropertyOf {rng.choice(_RELATIONS)}"
    return _insert([below, *(f"{_my(i)} {own} {_its(rng)}" for i in range(4))])


def _merge(rng: random.Random) -> str:
    n = rng.randrange(10**6)
    relation = rng.choice(("rt:hasOutcome", "rt:graspPose", "rt:evaluates", "rt:acquiredBy"))
    return _insert(
        [f"{_my(n)} {relation} {_my(f'w{n}')} , {_its(rng)}", f"{_my(f'w{n}')} a rt:Grasp"]
    )


def _cells(rng: random.Random) -> str:
    return _each(rng, lambda: f"{_its(rng)} rdf:first {_its(rng)} ; rdf:rest {_its(rng)}")


def _reified(rng: random.Random) -> str:
    return _each(
        rng, lambda: f"<< {_its(rng)} a rt:Mug >> rt:confidence {rng.choice((0, -1, '0.0e0'))}"
    )


def _foreign_graph(rng: random.Random) -> str:
    graph = rng.choice((f"{BASE}graph/agent/{rng.choice(VICTIMS)}", f"{BASE}graph/shared"))
    return _insert([f"{_its(rng)} a rt:Grasp"], f"GRAPH <{graph}> {{")


def _system_graph(rng: random.Random) -> str:
    graph = rng.choice(("inferred", "quarantine", "meta", "provenance", "rules"))
    return _insert([f"{_its(rng)} a rt:Grasp"], f"GRAPH <{BASE}graph/{graph}> {{")


def _in_their_name(rng: random.Random) -> str:
    told = rng.choice(("prov:wasAttributedTo", "prov:wasAssociatedWith", "rt:performedBy"))
    return _insert([f"{_my(rng.randrange(99))} {told} {_robot(rng)}"])


def _spelled(rng: random.Random) -> str:
    """Return claims about IRIs that look like those of others."""
    victim, n = rng.choice(VICTIMS), rng.randrange(THINGS)
    odd = (
        f"robot/{victim.replace('-', '%2D')}/thing{n}", f"robot/{victim}%2Fthing{n}",
        f"robot/{victim}//thing{n}", f"robot/{victim}#thing{n}",
        f"robot/{HOSTILE}/../{victim}/thing{n}",
        f"agent/{victim}/thing{n}", f"person/{victim}/thing{n}",
    )  # fmt: skip
    return _insert([f"<{BASE}{path}> a rt:Grasp ; rt:serialNumber 'fake'" for path in odd])


def _delete(rng: random.Random) -> str:
    return rng.choice(
        (
            f"{PREFIXES}DELETE {{ GRAPH ?g {{ ?s ?p ?o }} }} "
            "WHERE { GRAPH ?g { ?s a rt:Mug ; ?p ?o } }",
            f"DELETE WHERE {{ {_its(rng)} ?p ?o }}",
            f"CLEAR GRAPH <{BASE}graph/agent/{rng.choice(VICTIMS)}>",
            f"MOVE <{BASE}graph/agent/{rng.choice(VICTIMS)}> TO <{BASE}graph/agent/{HOSTILE}>",
        )
    )  # fmt: skip


def _copied(rng: random.Random) -> str:
    """Return an update that states of its own names whatever others state of theirs."""
    return (
        f"{PREFIXES}INSERT {{ ?o ?p ?s . ?s a rt:Grasp }} WHERE {{ ?s a rt:Mug ; ?p ?o "
        "FILTER(isIRI(?o)) }"
    )


KINDS: dict[str, Callable[[random.Random], str]] = {
    "class": lambda rng: _each(rng, lambda: f"{_its(rng)} a {rng.choice(_CLASSES)}", 1),
    "class of the robot": lambda rng: _insert([f"{_robot(rng)} a {rng.choice(_CLASSES)}"]),
    "value": lambda rng: _each(
        rng, lambda: f"{_its(rng)} {rng.choice(_VALUES)} {_literal(rng)}", 1
    ),
    "serial number": lambda rng: _insert([f"{_robot(rng)} rt:serialNumber '{rng.random()}'"]),
    "relation to": lambda rng: _insert([f"{_my('m')} {rng.choice(_RELATIONS)} {_its(rng)}"]),
    "relation from": lambda rng: _insert([f"{_its(rng)} {rng.choice(_RELATIONS)} {_my('m')}"]),
    "relation between": lambda rng: _insert([f"{_its(rng)} {rng.choice(_RELATIONS)} {_its(rng)}"]),
    "range of an own property": _own_schema,
    "own class of processes": _two_parents,
    "own class without members": _impossible_class,
    "own transitive property": _chain,
    "own irreflexive property": _irreflexive,
    "below a shipped property": _below_shipped,
    "merge by a function": _merge,
    "cells of lists": _cells,
    "annotated": _reified,
    "graph of another": _foreign_graph,
    "graph of the store": _system_graph,
    "in another's name": _in_their_name,
    "spelled otherwise": _spelled,
    "deletion": _delete,
    "copied": _copied,
    "id": lambda rng: _insert([f"{_its(rng)} a rt:Mug ; rt:objectId '{_its(rng)[-9:-1]}'"]),
    "many claims": lambda rng: _each(rng, lambda: f"{_its(rng)} rt:bestMatch {_my('m')}", 800),
    "long text": lambda rng: _insert([f"{_its(rng)} rdfs:comment '{'x' * 500_000}'"]),
}
"""An update of each kind."""


def hostile_claims(seed: int, count: int) -> list[tuple[str, str]]:
    """Return updates with their kinds, each kind in turn."""
    rng, kinds = random.Random(seed), list(KINDS)
    return [(kind, KINDS[kind](rng)) for kind in (kinds[i % len(kinds)] for i in range(count))]


def own_statements(name: str, number: int) -> str:
    """Return what a robot states about one of its things, and about itself."""
    its = f"<{BASE}robot/{name}/thing{number}>"
    here = f"<{BASE}robot/{name}>"
    return _insert(
        [
            f"{its} a rt:Mug ; rdfs:label 'thing {number}' ; rt:objectId '{name}/{number}' ; "
            f"rt:mass 0.3e0",
            f"{here} a cora:Robot ; rt:serialNumber 'serial of {name}'",
            f"<{BASE}robot/{name}/try{number}> a rt:Grasp ; rdfs:label 'grasp of thing {number}'",
        ]
    )
