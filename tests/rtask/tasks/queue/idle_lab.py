"""A lab in which one robot gets all of a plan, and two others could help with it."""

from __future__ import annotations

from collections.abc import Collection

from rtask.rdf.namespaces import PREFIXES
from tests.rtask.tasks.conftest import BASE, LEFT, NAO, PANDA, RIGHT, TABLE, placed, robot

OTHER = f"{BASE}robot/nao-2"
GOAL = "every cup into the left box"


def thing(number: int) -> str:
    """Return the IRI of a thing."""
    return f"{BASE}thing/{number}"


def _product(number: int, kind: str, name: str, mass: float = 0.1) -> str:
    return (
        f'<{BASE}object/{number}> a rt:{kind} ; rt:objectId "lab/{number}" ; rt:name "{name}" ; '
        f"rt:graspWidth 0.04e0 ; rt:mass {mass}e0 . {placed(number, TABLE)}"
    )


def idle_lab(cups: int = 4, pens: int = 0, heavy: Collection[int] = ()) -> str:
    """Return the update that states the lab: the Panda reaches all, and the Naos nothing yet.

    Parameters
    ----------
    heavy
        Numbers of the cups that no Nao can lift.
    """
    things = [_product(n, "Cup", f"cup-{n}", 1.0 if n in heavy else 0.1) for n in range(cups)]
    things += [_product(n, "Pen", f"pen-{n}") for n in range(cups, cups + pens)]
    return f"""{PREFIXES}
INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
  {robot(NAO, "nao-1", "Hand", 0.05, 0.2)}
  {robot(OTHER, "nao-2", "Hand", 0.05, 0.2)}
  {robot(PANDA, "panda-1", "ParallelJawGripper", 0.08, 3.0)}
  <{TABLE}> a rt:SupportSurface ; rt:name "table" .
  <{LEFT}> a rt:SupportSurface ; rt:name "left box" .
  <{RIGHT}> a rt:SupportSurface ; rt:name "right box" .
  <{PANDA}> rt:reaches <{TABLE}>, <{LEFT}>, <{RIGHT}> .
  {" ".join(things)}
}} }}"""


def reach_of(*robots: str) -> str:
    """Return the update by which robots reach all places from now on."""
    rows = " ".join(f"<{each}> rt:reaches <{TABLE}>, <{LEFT}>, <{RIGHT}> ." for each in robots)
    return f"{PREFIXES} INSERT DATA {{ GRAPH <{BASE}graph/shared> {{ {rows} }} }}"
