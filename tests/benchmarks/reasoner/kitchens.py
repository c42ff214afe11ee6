"""Kitchens with robots, trays and tasks, under a small schema: data for measuring a closure.

The schema has transitivity, inverses, symmetry, hierarchies, a union, an intersection,
restrictions and a disjointness. The order of random draws fixes the size of the closure.
"""

from __future__ import annotations

import random
from collections.abc import Callable

from pyoxigraph import BlankNode, Literal, NamedNode

BENCH = "http://bench/"
RDF, RDFS, OWL, XSD = (
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#",
    "http://www.w3.org/2000/01/rdf-schema#",
    "http://www.w3.org/2002/07/owl#",
    "http://www.w3.org/2001/XMLSchema#",
)
CLOSURE_SIZES = {10_000: 34_134, 100_000: 341_023, 1_000_000: 3_402_555}
"""Facts and what follows from them, without schema triples and what is true of everything."""

Term = NamedNode | BlankNode | Literal
Triple = tuple[Term, Term, Term]

SUBCLASSES = """
Physical Abstract < Entity; Object Process < Physical; Agent Artifact Region RedThing < Object;
Device Container Tool Furniture KitchenItem < Artifact; Robot EndEffector Sensor < Device;
Robot < Agent; MobileRobot ManipulatorRobot < Robot; HumanoidRobot < MobileRobot; Camera < Sensor;
Task Motion < Process; Manipulation < Task; Grasp Push < Manipulation; Cup Bottle Tray < Container;
Room < Region; Kitchen < Room avfKitchen; Table < Furniture
"""
SUBPROPERTIES = "performs < participatesIn; hasGripper hasSensor < hasPart"
SIDES = """
partOf Object Object; locatedIn Physical Object; performs Agent Process;
hasGripper Robot EndEffector; hasSensor Device Sensor; handles Task Object; requires Task Motion;
activates Manipulation EndEffector
"""
INVERSES = "hasPart partOf; contains locatedIn; performedBy performs"
OBJECT_PROPERTIES = """partOf hasPart locatedIn contains performs performedBy participatesIn
hasGripper hasSensor adjacentTo handles requires hasColor activates"""


def n(name: str, namespace: str = BENCH) -> NamedNode:
    """Return an IRI."""
    return NamedNode(namespace + name)


TYPE = n("type", RDF)


def schema() -> list[Triple]:
    """Return the schema; anonymous classes have names, so that closures compare as sets."""
    out: list[Triple] = []
    for text, p in ((SUBCLASSES, "subClassOf"), (SUBPROPERTIES, "subPropertyOf")):
        for part in text.split(";"):
            below, above = (side.split() for side in part.split("<"))
            out += [(n(a), n(p, RDFS), n(b)) for a in below for b in above]
    for part in SIDES.split(";"):
        p, domain, range_ = part.split()
        out += [(n(p), n("domain", RDFS), n(domain)), (n(p), n("range", RDFS), n(range_))]
    for part in INVERSES.split(";"):
        p, q = part.split()
        out.append((n(p), n("inverseOf", OWL), n(q)))
    out += [(n(p), TYPE, n("ObjectProperty", OWL)) for p in OBJECT_PROPERTIES.split()]
    out += [(n(p), TYPE, n("DatatypeProperty", OWL)) for p in ("width", "ident")]
    out += [(n(p), TYPE, n("TransitiveProperty", OWL)) for p in ("partOf", "locatedIn")]
    out.append((n("adjacentTo"), TYPE, n("SymmetricProperty", OWL)))
    out.append((n("Object"), n("disjointWith", OWL), n("Process")))
    out += _list("EndEffector", "unionOf", ["Gripper", "Hand", "SuctionCup"])
    out += _list("ManipulatorRobot", "intersectionOf", ["Robot", "svfGripper"])
    out += _restriction("svfGripper", "hasGripper", "someValuesFrom", "Gripper")
    out += _restriction("hvRed", "hasColor", "hasValue", "red")
    out += _restriction("avfKitchen", "contains", "allValuesFrom", "KitchenItem")
    out += [
        (n("RedThing"), n("subClassOf", RDFS), n("hvRed")),
        (n("hvRed"), n("subClassOf", RDFS), n("RedThing")),
    ]
    return out


def _list(name: str, kind: str, members: list[str]) -> list[Triple]:
    nodes = [n(f"list_{name}_{i}") for i in range(len(members))]
    out: list[Triple] = [(n(name), n(kind, OWL), nodes[0])]
    for node, member, rest in zip(nodes, members, [*nodes[1:], n("nil", RDF)], strict=True):
        out += [(node, n("first", RDF), n(member)), (node, n("rest", RDF), rest)]
    return out


def _restriction(name: str, p: str, kind: str, filler: str) -> list[Triple]:
    return [(n(name), n("onProperty", OWL), n(p)), (n(name), n(kind, OWL), n(filler))]


def facts(size: int, seed: int = 1) -> list[Triple]:
    """Return kitchens until there are `size` facts; the order of draws fixes the counts."""
    chance = random.Random(seed)
    out: list[Triple] = []

    def say(s: str, p: str, o: str | float) -> None:
        if p == "type":
            out.append((n(s), TYPE, n(str(o))))
        elif p == "ident":
            out.append((n(s), n(p), Literal(str(o))))
        else:
            out.append((n(s), n(p), Literal(o) if isinstance(o, float) else n(o)))

    kitchen = 0
    while len(out) < size:
        _kitchen(f"c{kitchen}_", f"c{kitchen - 1}_" if kitchen else "", chance, say)
        kitchen += 1
    return out[:size]


def _kitchen(
    c: str, before: str, chance: random.Random, say: Callable[[str, str, str | float], None]
) -> None:
    room = c + "room"
    say(room, "type", "Kitchen" if chance.random() < 0.3 else "Room")
    if before:
        say(room, "adjacentTo", before + "room")
    trays, robots, grippers, objects = [], [], [], []
    for i in range(3):
        table = f"{c}tab{i}"
        say(table, "type", "Table")
        say(table, "locatedIn", room)
        for j in range(2):
            tray = f"{c}tray{i}_{j}"
            say(tray, "type", "Tray")
            say(tray, "locatedIn", table)
            trays.append(tray)
    for i in range(3):
        robot, gripper, finger, camera = (f"{c}{w}{i}" for w in ("rob", "grip", "finger", "cam"))
        robots.append(robot)
        grippers.append(gripper)
        say(robot, "type", chance.choice(["Robot", "MobileRobot", "HumanoidRobot"]))
        say(robot, "locatedIn", room)
        say(gripper, "type", chance.choice(["Gripper", "Hand", "SuctionCup"]))
        say(robot, "hasGripper", gripper)
        say(finger, "partOf", gripper)
        say(camera, "type", "Camera")
        say(robot, "hasSensor", camera)
    for i in range(30):
        thing = f"{c}obj{i}"
        objects.append(thing)
        say(thing, "type", chance.choice(["Cup", "Bottle", "Tool"]))
        say(thing, "locatedIn", chance.choice(trays))
        say(thing, "hasColor", chance.choice(["red", "green", "blue"]))
        say(thing, "ident", thing)
        say(thing, "width", chance.randint(10, 120) / 1000)
    for i in range(20):
        task, q = f"{c}task{i}", chance.randrange(3)
        say(task, "type", chance.choice(["Grasp", "Push", "Task"]))
        say(task, "performedBy", robots[q])
        say(task, "handles", chance.choice(objects))
        say(task, "requires", f"{c}mot{i}")
        say(task, "activates", grippers[q])


def size_of_closure(asserted: list[Triple], inferred: list[Triple]) -> int:
    """Return the number of distinct facts, schema triples left out."""
    known = set(schema())
    return sum(1 for t in {*asserted, *inferred} - known if not t[1].value.startswith((RDFS, OWL)))
