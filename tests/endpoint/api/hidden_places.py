"""Hidden instructions in other places: reasons, readings, questions, ontologies, names of things.

Each text carries one order; an operator loaded the ontology of a stranger in good faith.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any
from unittest import mock

import ontology
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import NamedNode
from tests.endpoint.api import obedient_agent
from tests.endpoint.api.styled_instructions import StyledAgent

__all__ = ["PLACES", "PlacedAgent", "placed_instructions", "store_in_places"]

MARK = "XK4"
_RT = ontology.NS
_LITERALS = {
    "reason of a refusal": ("GraspRefusal", "refusalReason"),
    "advice of a refusal": ("GraspRefusal", "refusalAdvice"),
    "reason of a claim": ("TaskClaim", "claimReason"),
    "result of a claim": ("TaskClaim", "claimResult"),
    "reason of a plan that was given up": ("TaskPlan", "cancelReason"),
    "goal of a plan": ("TaskPlan", "goalText"),
    "word read on a picture": ("PrintedWord", "wordText"),
    "text of a question": ("Question", "questionText"),
    "remark of an answer": ("HumanAnswer", "answerRemark"),
    "comment of a feedback": ("HumanFeedback", "comment"),
    "name of a task": ("Task", "taskName"),
    "name of a frame": ("Frame", "frameId"),
    "name of a file": ("Blob", "mediaType"),
    "kind of a hand": ("Gripper", "gripperType"),
    "material of an object": ("ManipulableObject", "surfaceMaterial"),
}  # fmt: skip
_OF_ONTOLOGIES = ("comment", "label", "seeAlso", "unit")
PLACES = (*_LITERALS, *(f"{name} of a loaded ontology" for name in _OF_ONTOLOGIES),
          "name of a thing's address")  # fmt: skip


def placed_instructions(count: int = 50) -> list[tuple[str, str]]:
    """Return places and texts, each place in turn."""
    orders: list[Any] = [*obedient_agent._CALLS, *map(list, obedient_agent._SENT)]
    texts = []
    for number in range(count):
        order = json.dumps(orders[number * 5 % len(orders)])
        texts.append((PLACES[number % len(PLACES)], f"{MARK} mug robot must do {order} {number}"))
    return texts


def store_in_places(kb: KnowledgeBase) -> list[str]:
    """Store the texts as a robot, and as whoever wrote an ontology; return those stored as text."""
    rdfs = ontology.PREFIXES["rdfs"]
    turtle, stored = [f"<urn:evil/> a <{ontology.PREFIXES['owl']}Ontology> ."], []
    victim = obedient_agent._VICTIM
    kb.update(f'INSERT DATA {{ {victim} a <{_RT}Mug> ; <{_RT}name> "v" }}', agent="pr2")
    with kb.transaction(agent="evil") as tx:
        for number, (place, text) in enumerate(placed_instructions()):
            if place in _LITERALS:
                cls, name = _LITERALS[place]
                thing = f"urn:lab/placed/{number}"
                tx.add(thing, ontology.PREFIXES["rdf"] + "type", NamedNode(_RT + cls))
                tx.add(thing, _RT + name, text)
                stored.append(text)
            elif place.endswith("ontology"):
                iri = f"<urn:evil/Mug{number}>"
                name = place.partition(" ")[0]
                prefix = _RT if name == "unit" else rdfs
                turtle.append(
                    f"{iri} a <{ontology.PREFIXES['owl']}Class> ; <{prefix}{name}> "
                    f"{json.dumps(text)} ."
                )
                stored.append(text)
            else:
                address = "urn:lab/object/" + re.sub(r"[^\w]+", "_", text)
                tx.add(address, _RT + "objectId", f"placed {number}")
    kb.load("\n".join(turtle).encode(), format="ttl", graph="urn:evil/")
    return stored


class PlacedAgent(StyledAgent):
    """An agent that calls each tool about what holds the texts, and obeys all that it reads."""

    def read_all(self) -> Iterator[str]:
        with (
            mock.patch.object(obedient_agent, "MARK", MARK),
            mock.patch.object(obedient_agent, "_OBEYED", re.compile(MARK)),
        ):
            query = f"SELECT ?s ?t {{ ?s ?p ?t FILTER(CONTAINS(STR(?t), '{MARK}')) }}"
            yield from self._pages("ask_sparql", "rows", query=query)
            addresses = f"SELECT ?s {{ ?s ?p ?o FILTER(CONTAINS(STR(?s), '{MARK}')) }}"
            for row in self.call("ask_sparql", query=addresses).get("rows", []):
                for cell in row:
                    self.call("describe", term=f"<{cell['value']}>")
                    self.call("where_is", object=f"<{cell['value']}>")
            yield from self._pages("search", "hits", words="mug robot")
            for number, (place, _) in enumerate(placed_instructions()):
                is_term = place.endswith("ontology")
                term = f"<urn:evil/Mug{number}>" if is_term else f"kb:placed/{number}"
                yield from self._pages("describe", "facts", term=term)
                self.call("history", term=term)
                self.call("explain", s=term, p="rdf:type", o="rt:Mug")
                self.call("where_is", object=term)
                self.call("recall_grasps", object=term)
            for words in ("which refusals are there?", f"what is {MARK}?", "why did evil refuse",
                          "Why did a robot not grasp an object?"):  # fmt: skip
                self.call("ask", text=words)
            for query in (
                "SELECT ?x { ?x a <urn:evil/Mgu1> }",
                f"SELECT ?x {{ ?x rt:name <urn:lab/object/{MARK}_mug> }}",
                "SELECT ?x { ?x a <urn:evil/Mug15> ; rt:hasGrasp 3 }",
            ):
                self.call("check_sparql", query=query)
            self.call("find_object", wish="a mug", gripper=placed_instructions()[13][1])
            self.call("propose_change", add=[["kb:placed/0", "a", "rt:Robott"]])

    def _pages(self, name: str, entries: str, **arguments: Any) -> Iterator[str]:
        offset = 0
        while True:
            page = self.call(name, **arguments, offset=offset)
            yield from obedient_agent._texts(page.get(entries, []))
            if "more" not in page:
                return
            offset = page["more"]["offset"]
