"""Place functions in SPARQL: near, above, inside, in reach, at a position in a frame."""

from __future__ import annotations

import datetime as dt
import itertools

import pytest

import ontology
from rtask.errors import ForbiddenError, QuerySyntaxError, TooLargeError
from rtask.rdf.namespaces import PREFIXES
from rtask.world import relations
from tests.rtask.world.conftest import BASE

HEAD = f"{PREFIXES}PREFIX rtf: <{ontology.FUNCTIONS}>\nPREFIX : <{BASE}>\n"


@pytest.fixture
def ask(lab):
    """Return what asks one block, and gives the names of the rows' values."""

    def ask(block, time_s=None, rest="", **options):
        at = "" if time_s is None else f'; rtf:at "{_stamp(lab.noon + time_s)}"^^xsd:dateTime '
        text = f"{HEAD}SELECT * {{ SERVICE <urn:rtask:place> {{ {block} {at}}} {rest} }}"
        return [row.to_dict() for row in lab.kb.select(text, **options)]

    return ask


def _stamp(time_s):
    return dt.datetime.fromtimestamp(time_s, dt.UTC).isoformat()


@pytest.fixture
def things(lab):
    """Return a cup, a box 20 cm beside it, a cup over the box and one seen by another robot."""
    lab.stand(lab.table, lab.map, 1.0, 0.0, -100)
    lab.stand(lab.frame("nao-2"), lab.map, 3.0, 0.0, -100)
    cup = lab.see(lab.cup, 0.3, 0.0, 0, frame=lab.table)
    box = lab.see(lab.box, 0.5, 0.0, 0, frame=lab.table)
    edit = lab.edit()
    high = edit.see(lab.seen(lab.cup, 0.52, 0.0, 0, frame=lab.table))
    lab.commit(edit, "nao-1")
    lifted = lab.edit()
    seen = lab.seen(lab.cup, 0.52, 0.0, 1, frame=lab.table, exemplar=high)
    seen.frame_from_exemplar[2, 3] = 0.15
    lifted.see(seen)
    lab.commit(lifted, "nao-1")
    far = lab.see(lab.cup, 0.1, 0.0, 0, robot="nao-2")
    return cup, box, high, far


def test_what_is_near_with_its_distance_in_any_frame_of_the_tree(ask, things):
    cup, box, high, far = things
    rows = ask("?a rtf:near ?b ; rtf:within 0.25 ; rtf:distance ?d ; rtf:chance ?p", 10)
    pairs = {(row["a"], row["b"]): row for row in rows}
    assert set(pairs) == {(cup, box), (box, cup), (box, high), (high, box)}
    assert pairs[cup, box]["d"] == pytest.approx(0.2)
    assert 0.5 < pairs[cup, box]["p"] <= 1.0
    assert {row["a"] for row in ask(f"?a rtf:near <{far}> ; rtf:within 1.7", 10)} == {box, high}
    assert {row["a"] for row in ask(f"?a rtf:near <{BASE}frame/map> ; rtf:within 1.4", 10)} == {cup}
    assert {row["a"] for row in ask(f"?a rtf:near <{BASE}robot/nao-2>", 10)} == {far}


def test_a_thing_that_turned_out_to_be_another_one_was_near_under_the_name_that_stays(
    lab, ask, things
):
    cup, box, *_ = things
    lab.see(lab.box, 0.5, 0.0, 70, frame=lab.table)
    moved = lab.see(lab.box, 0.3, 0.2, 3670, frame=lab.table)
    assert moved != box, "it is not known yet which box this is"
    lab.lose(box, 3700)
    assert lab.kb.world.is_merged(moved)
    rows = ask(f"<{cup}> rtf:near ?b ; rtf:within 0.25 ; rtf:distance ?d", 3680)
    assert [(row["b"], row["d"]) for row in rows] == [(box, pytest.approx(0.2))]
    (row,) = ask(f"<{cup}> rtf:near <{moved}> ; rtf:within 0.25", 3680)
    assert row == {}, "the name of before stands for the same thing"


def test_what_is_above_and_what_can_be_joined_to_the_rest_of_a_query(lab, ask, things):
    _, box, high, _ = things
    assert [(row["a"], row["b"]) for row in ask("?a rtf:above ?b", 10)] == [(high, box)]
    rest = '?a rt:exemplarOf/rt:name ?name FILTER(CONTAINS(?name, "cup"))'
    (row,) = ask(f"?a rtf:above <{box}> ; rtf:distance ?d", 10, rest)
    assert (row["name"], row["d"]) == ("blue cup", pytest.approx(0.1513, abs=1e-3))
    assert lab.kb.query(
        f'{HEAD}ASK {{ SERVICE <urn:rtask:place> {{ <{high}> rtf:above <{box}> }} }}'
    ), "now, without a time"  # fmt: skip
    assert not ask("?a rtf:above ?b", 0.5), "it was lifted later"


def test_what_is_inside_also_of_what_is_inside(lab, ask, things):
    cup, box, *_ = things
    lab.put(cup, "in", box, 20)
    lab.put(box, "in", lab.left_box, 30)
    assert {row["c"] for row in ask(f"<{cup}> rtf:inside ?c", 40)} == {box, lab.left_box}
    assert {row["c"] for row in ask(f"<{cup}> rtf:inside ?c", 25)} == {box}
    assert {row["a"] for row in ask("?a rtf:inside :robot\\/nao-1\\/place\\/left%20box", 40)} == {
        cup, box,
    }  # fmt: skip
    near = f"<{cup}> rtf:near <{BASE}frame/map> ; rtf:within 1.6 ; rtf:distance ?d"
    assert ask(near, 25)[0]["d"] == pytest.approx(1.5), "it is where the box is"


def test_what_is_inside_is_found_however_deep_it_lies(lab, ask, things):
    cup, box, *_ = things
    beside = [lab.see(lab.box, 0.5 + 0.3 * k, 0.0, 0, frame=lab.table) for k in range(1, 11)]
    chain = [cup, box, *beside]
    for k, (inner, outer) in enumerate(itertools.pairwise(chain)):
        lab.put(inner, "in", outer, 20 + k)
    assert {row["c"] for row in ask(f"<{cup}> rtf:inside ?c", 60)} == set(chain[1:])
    near = f"<{cup}> rtf:near <{BASE}frame/map> ; rtf:within 9 ; rtf:distance ?d"
    assert ask(near, 60)[0]["d"] == pytest.approx(4.5), "it is where the outermost box is"


def test_what_a_robot_reaches_by_its_places_and_by_its_arm(lab, ask, things):
    cup, _, _, far = things
    lab.put(cup, "in", lab.left_box, 20)
    nao = f"{BASE}robot/nao-1"
    assert not ask("?a rtf:reachedBy ?robot", 40)
    lab.kb.update(f"{PREFIXES} INSERT DATA {{ <{nao}> rt:reaches <{lab.left_box}> }}")
    (row,) = ask("?a rtf:reachedBy ?robot ; rtf:distance ?d", 40)
    assert (row["a"], row["robot"]) == (cup, nao)
    assert row["d"] is None, "nobody said where the robot stands"
    assert {row["a"] for row in ask(f"?a rtf:reachedBy <{BASE}robot/nao-2> ; rtf:within 0.4", 40)} \
        == {far}  # fmt: skip


def test_positions_in_the_frame_of_anything(lab, ask, things):
    cup, box, *_ = things
    (row,) = ask(f"<{cup}> rtf:poseIn <{lab.map}> ; rtf:x ?x ; rtf:y ?y", 10)
    assert (row["x"], row["y"]) == pytest.approx((1.3, 0.0))
    (row,) = ask(f"<{cup}> rtf:poseIn <{box}> ; rtf:x ?x", 10)
    assert row["x"] == pytest.approx(-0.2)
    lab.kb.update(f"{PREFIXES} INSERT {{ ?a rt:description ?text }} WHERE {{ "
                  f"SERVICE <urn:rtask:place> {{ ?a <{ontology.FUNCTIONS}near> <{box}> }} "
                  "BIND(\"beside\" AS ?text) }")  # fmt: skip
    assert len(lab.kb.match(None, f"{ontology.NS}description")) == 2, "in updates as well"


def test_what_has_no_known_place_is_in_no_pair(lab, ask, things):
    cup, *_ = things
    lab.lose(cup, 20)
    assert not ask(f"<{cup}> rtf:near ?b ; rtf:within 9", 25)
    assert ask(f"<{cup}> rtf:near ?b ; rtf:within 9", 15)
    stray = lab.see(lab.box, 0.0, 0.0, 20)
    assert not ask(f"<{stray}> rtf:near ?b ; rtf:within 99", 25), "its frame stands nowhere known"


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ("?a rtf:beside ?b", "rtf:beside"),
        ("?a rtf:distance ?d", "no relation: one of rtf:near, rtf:above"),
        ("?a rtf:near ?a", "two different values"),
        ("?a rtf:near ?b ; rtf:x ?x", "rtf:near answers rtf:distance, rtf:chance, not rtf:x"),
        ("?a rtf:near ?b ; rtf:within ?w", "cannot be asked"),
        ("?a rtf:near ?b ; rtf:within 0", "cannot be asked"),
        ('?a rtf:near ?b ; rtf:at "noon"', "rtf:at"),
        ("?a rtf:poseIn ?b ; rtf:x ?x", "needs the IRI"),
        ("?a rtf:near ?b . ?b rtf:near ?c", "expected ';'"),
        ("?a rt:near ?b", "is no place function"),
        ("?a rtf:near", "has no value"),
        ("", "expected"),
    ],
)
def test_what_cannot_be_asked_says_what_can(ask, block, message):
    with pytest.raises(QuerySyntaxError, match=message):
        ask(block)


def test_bounds_are_said_and_nothing_is_left_out_silently(lab, ask, things, monkeypatch):
    monkeypatch.setattr(relations, "MAX_ROWS", 3)
    with pytest.raises(TooLargeError, match="more than 3 pairs to compare; name the thing"):
        ask("?a rtf:near ?b", 10)
    monkeypatch.setattr(relations, "MAX_COMPARED", 3)
    with pytest.raises(TooLargeError, match="more than 3 things"):
        ask("?a rtf:near ?b ; rtf:within 0.01", 10)


def test_a_query_with_a_time_limit_and_a_stream_answer_the_same(lab, ask, things):
    block = "?a rtf:above ?b"
    assert ask(block, 10, timeout_s=30.0) == ask(block, 10)
    text = f"{HEAD}SELECT * {{ SERVICE <urn:rtask:place> {{ {block} }} }}"
    assert lab.kb.encode_query(text) is None, "a reader cannot answer it alone"
    with lab.kb.stream(text) as stream:
        assert things[2].encode() in stream.read()
    with pytest.raises(ForbiddenError):
        lab.kb.query(f"{HEAD}SELECT * {{ SERVICE <urn:rtask:places> {{ {block} }} }}")
