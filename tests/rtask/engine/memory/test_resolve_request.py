"""Ask for a kind or a use of thing: one seen object that serves and can be held, or why not."""

from __future__ import annotations

import re
from contextlib import contextmanager

import pytest

import ontology
import rtask
from rtask.engine import Engine
from rtask.engine.memory.meaning import meaning, stems
from rtask.engine.operations.resolution import candidates
from rtask.errors import UnknownTermError
from rtask.kb.commit.access import Access

pytestmark = pytest.mark.slow

RT = ontology.NS
ANN = Access("ann", "teacher")


class Room:
    """A reasoning store, a robot in it, and things that were met before."""

    def __init__(self, bench, engine):
        self.engine, self.bench = engine, bench
        self.robot = bench.Robot("nao-1", engine)
        self.robot.register()
        self.cola = self.meet(bench.CAN, "cola", "can")
        wide = bench.Thing((0.09, 0.08, 0.1), texture_seed=9)
        self.bottle = self.meet(wide, "big bottle", "bottle")
        self.pencil = self.meet(bench.PEN, "pencil", "pen")
        mug = bench.Thing((0.04, 0.04, 0.06), texture_seed=11)
        self.mug = self.meet(mug, "blue mug", "mug")

    def meet(self, thing, name, words):
        told = self.robot.insert(self.bench.sight(thing), name=name, class_description=words)
        return told["objects"][0]["object"]

    def ask(self, wanted, **more):
        return self.robot.call("resolve_request", wanted=wanted, **more)

    def state(self, text):
        self.engine.kb.update(f"PREFIX rt: <{RT}> INSERT DATA {{ {text} }}", agent="ann")


@contextmanager
def furnished(bench):
    """A room with what was met before, of which two things were weighed."""
    with rtask.open(":memory:", base="https://example.org/kb/") as kb, Engine(kb) as engine:
        made = Room(bench, engine)
        made.state(f"<{made.cola}> rt:mass 0.25e0 . <{made.mug}> rt:mass 0.9e0")
        yield made


@pytest.fixture(scope="module")
def room(bench):
    """One room for all tests that only ask."""
    with furnished(bench) as made:
        yield made


@pytest.fixture
def own_room(bench):
    """A room for a test that adds to it."""
    with furnished(bench) as made:
        yield made


def test_a_use_is_resolved_by_what_the_kinds_are_for(room):
    """No can is said to be for drinking: the ontology says so of its class."""
    answer = room.ask("bring me something to drink from")
    assert answer["task_response"] == "object"
    assert answer["object"] == room.cola
    assert answer["understood"]["functions"] == [RT + "drinkFrom"]
    assert [one["label"] for one in answer["objects"]] == ["cola"]
    assert answer["objects"][0]["capability"] == "proven"


def test_what_cannot_be_held_is_told_with_both_numbers(room):
    reasons = {one["label"]: one for one in room.ask("something to drink from")["reasons"]}
    assert set(reasons) == {"big bottle", "blue mug"}
    assert reasons["big bottle"]["code"] == "too_wide"
    assert reasons["big bottle"]["value"] == pytest.approx(0.08, abs=0.003)
    assert reasons["big bottle"]["limit"] == 0.05
    assert "80 mm wide, and the hand opens 50 mm" in reasons["big bottle"]["text"]
    assert (reasons["blue mug"]["code"], reasons["blue mug"]["value"]) == ("too_heavy", 0.9)


def test_the_proof_is_the_reasoners(room):
    proof = "\n".join(room.ask("something to drink from")["explanation"]["proof"])
    assert "rt:hasFunction rt:drinkFrom" in proof
    assert "a rt:Can" in proof
    assert "rule:canGrasp" in proof
    assert room.ask("something to drink from", prove=False)["explanation"]["proof"] == []


@pytest.mark.parametrize("wanted", ["a can", "cans", RT + "Can", "hand me the cola can, please"])
def test_a_kind_is_found_by_its_words_or_its_iri(room, wanted):
    answer = room.ask(wanted)
    assert answer["object"] == room.cola
    assert answer["understood"]["classes"] == [RT + "Can"]


def test_a_modal_can_is_no_can(room):
    answer = room.ask("something that I can write with")
    assert answer["understood"] == {
        "classes": [], "functions": [RT + "write"], "colours": [], "traits": [],
        "printed": [], "ignored": [],
    }  # fmt: skip
    assert answer["object"] == room.pencil


def test_kind_and_use_narrow_each_other(room):
    assert room.ask("a pen to drink from")["task_response"] == "unmet"
    assert room.ask("a can to drink from")["object"] == room.cola


def test_only_what_is_seen_is_offered(room):
    answer = room.ask("something to drink from", objects=[room.pencil, room.bottle])
    assert answer["task_response"] == "unmet"
    codes = [(one["code"], one["label"]) for one in answer["reasons"]]
    assert codes[0] == ("too_wide", "big bottle")
    assert ("elsewhere", "cola") in codes
    seen = next(one for one in answer["reasons"] if one["label"] == "cola")
    assert seen["seen_by"] == "nao-1"
    assert seen["seen"].startswith("20")
    assert "was seen at 20" in answer["explanation"]["text"]


def test_what_is_known_and_not_seen_is_told_with_its_place(own_room):
    own_room.state(
        "<urn:frame> a rt:Frame ; rt:frameId 'kitchen' ."
        f"<{own_room.pencil}> rt:hasPose <urn:pose> ."
        "<urn:pose> a rt:Pose ; rt:inFrame <urn:frame> ;"
        " rt:x 1.5e0 ; rt:y 0.25e0 ; rt:z 0.75e0 ; rt:qx 0e0 ; rt:qy 0e0 ; rt:qz 0e0 ; rt:qw 1e0 ;"
        " rt:atTime '2100-01-01T10:00:00Z'^^<http://www.w3.org/2001/XMLSchema#dateTimeStamp>"
    )
    answer = own_room.ask("a pen", objects=[])
    assert [one["code"] for one in answer["reasons"]] == ["not_seen", "elsewhere"]
    where = {"x": 1.5, "y": 0.25, "z": 0.75, "frame_id": "kitchen"}
    assert answer["reasons"][1]["place"] == where
    assert "at (1.50, 0.25, 0.75) of kitchen" in answer["reasons"][1]["text"]


def test_known_things_that_are_not_listed_are_counted(room, monkeypatch):
    monkeypatch.setattr("rtask.engine.operations.resolution.reasons._MAX_ELSEWHERE", 1)
    told = [one for one in room.ask("something to drink from", objects=[])["reasons"]
            if one["code"] == "elsewhere"]  # fmt: skip
    assert len(told) == 2
    assert told[0]["object"]
    assert re.match(r"\d+ more are known and not seen", told[1]["text"])


def test_an_old_look_does_not_count_as_seen(room):
    answer = room.ask("a pen", seen_within_s=0.0)
    assert [one["code"] for one in answer["reasons"]] == ["not_seen", "elsewhere"]
    assert room.ask("a pen", seen_within_s=1e300)["object"] == room.pencil


def test_words_without_meaning_get_the_nearest_names(room):
    answer = room.ask("a botle")
    assert answer["task_response"] == "unmet"
    assert answer["reasons"][0]["code"] == "no_such_kind"
    assert "bottle" in answer["suggestions"]
    assert "did you mean" in answer["explanation"]["text"]


def test_a_kind_of_which_nothing_is_known_says_so(room):
    codes = [one["code"] for one in room.ask("a ball")["reasons"]]
    assert codes == ["not_seen", "none_known"]


def test_what_was_excluded_is_not_offered_again(room):
    answer = room.ask("something to drink from", exclude=[room.cola])
    assert answer["task_response"] == "unmet"
    assert ("excluded", "cola") in [(r["code"], r["label"]) for r in answer["reasons"]]


def test_an_object_that_the_graph_does_not_know_is_refused(room):
    with pytest.raises(UnknownTermError, match="the graph has no object https://example"):
        room.ask("a can", objects=["https://example.org/no"])


def test_a_taught_kind_and_a_stated_use_count_as_well(own_room, bench):
    lamp = bench.Thing((0.03, 0.03, 0.05), texture_seed=21)
    made = own_room.robot.insert(
        bench.sight(lamp), name="torch", class_description="pocket lamp", function="illuminate"
    )["objects"][0]["object"]
    assert own_room.ask("something that gives light")["object"] == made
    assert own_room.ask("a pocket lamp")["object"] == made


def test_of_two_that_serve_the_one_with_the_surer_grasp_is_taken(own_room, bench):
    other = bench.Thing((0.038, 0.038, 0.07), True, texture_seed=31, yaw=0.0)
    seen = bench.sight(other)
    answer = own_room.robot.recognise(seen)
    told = own_room.robot.insert(
        seen, grasp=answer["grasps"][0], outcome=bench.held(), name="juice", class_description="can"
    )
    juice = told["objects"][0]["object"]
    first = own_room.ask("something to drink from", objects=[own_room.cola, juice])
    assert [one["label"] for one in first["objects"]] == ["juice", "cola"]
    assert first["grasps"][0]["statistics"]["successes"] == 1
    for k in range(9):
        own_room.robot.call(
            "report_outcome", task_id=f"urn:juice:{k}", object=juice, gripper_id="right_hand",
            grasp=first["grasps"][0]["id"], outcome=bench.missed(),
        )  # fmt: skip
    then = own_room.ask("something to drink from", objects=[own_room.cola, juice])
    assert [one["label"] for one in then["objects"]] == ["cola", "juice"]


def test_two_queries_answer_whatever_is_known(room, monkeypatch):
    room.ask("something to drink from", prove=False)  # names are read once
    asked = []
    select = type(room.engine.kb).select
    monkeypatch.setattr(
        type(room.engine.kb), "select", lambda kb, text, **k: asked.append(text) or select(kb, text)
    )
    room.ask("something to drink from", prove=False)
    assert len(asked) <= 3  # objects, their grasps, and the stored confidences of the chosen one


def test_stems_do_not_mind_plural_and_gerund():
    assert stems("drinking vessels") == stems("a drink vessel")
    assert stems("cutting") == stems("cut")


def test_the_longest_name_wins(room):
    found = meaning(room.engine.context, "a drinking vessel")
    assert [(s.kind, s.terms) for s in found.senses] == [("class", (RT + "DrinkingVessel",))]


def test_a_wish_that_more_fit_than_were_looked_at_is_not_decided(room, monkeypatch):
    """The one left out may be the one that can be held."""
    whole = room.ask("a container")
    fitting = {one["object"] for one in (*whole["objects"], *whole["reasons"])}
    assert whole["objects_untried"] == 0
    monkeypatch.setattr(candidates, "MAX_CANDIDATES", 2)
    answer = room.ask("a container")
    assert answer["objects_untried"] == len(fitting) - 2
    assert answer["reasons"][-1]["code"] == "not_decided"
    assert f"of {len(fitting)} seen, only the 2 seen last" in answer["reasons"][-1]["text"]
    named = room.ask("a container", objects=[room.bottle, room.cola])
    assert (named["object"], named["objects_untried"]) == (room.cola, 0)


def test_objects_named_in_a_wish_are_found_behind_others_that_fit_it(room, monkeypatch):
    monkeypatch.setattr(candidates, "MAX_CANDIDATES", 1)
    answer = room.ask("a container", objects=[room.pencil])
    assert answer["objects_untried"] == 0
    assert answer["reasons"][0]["code"] == "not_seen"


def test_colours_that_a_camera_saw_and_traits_narrow_a_request(own_room):
    rows = own_room.engine.kb.select(
        f"PREFIX rt: <{RT}> PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#> "
        f"SELECT ?label {{ <{own_room.cola}> rt:hasColour/rdfs:label ?label }}"
    )
    shown = {str(row.value("label")) for row in rows}
    assert shown
    (other, *_) = sorted({"red", "green", "blue", "pink"} - shown)
    for colour in sorted(shown):
        answer = own_room.ask(f"the {colour} can")
        assert answer["object"] == own_room.cola
        assert f", {colour}" in answer["explanation"]["text"]
        assert answer["understood"]["colours"] == [RT + f"colour_{colour}"]
    assert own_room.ask(f"the {other} can")["task_response"] == "unmet"
    heavy = own_room.ask("something heavy")
    assert [one["label"] for one in heavy["reasons"]] == ["blue mug"]
    assert heavy["understood"]["traits"] == [RT + "trait_heavy"]
    assert own_room.ask("a heavy can")["task_response"] == "unmet"


def test_grasps_beyond_max_grasps_are_counted(own_room, bench):
    assert own_room.ask("something to drink from")["grasps_left_out"] == 0
    seen = bench.sight(bench.CAN)
    every = own_room.robot.recognise(seen, max_grasps=50)
    first = own_room.robot.recognise(seen, max_grasps=1)
    assert len(first["grasps"]) == 1 < len(every["grasps"])
    assert 1 + first["grasps_left_out"] == len(every["grasps"]) + every["grasps_left_out"]

    for number, grasp in enumerate(every["grasps"][:2]):
        told = {"grasp": grasp, "outcome": bench.held(), "task_id": f"urn:try:{number}"}
        own_room.robot.insert(seen, object=own_room.cola, **told)
    known = own_room.ask("something to drink from", max_grasps=50)
    cut = own_room.ask("something to drink from", max_grasps=1)
    assert len(cut["grasps"]) == 1
    assert cut["grasps_left_out"] == len(known["grasps"]) - 1 > 0
