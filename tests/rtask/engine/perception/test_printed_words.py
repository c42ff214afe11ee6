"""Words on views: stored as facts, found by people's words, and a veto against siblings."""

from __future__ import annotations

from dataclasses import replace

import cv2
import pytest

import rtask
from rtask.asking.questions import answer
from rtask.engine import Engine
from rtask.engine.networks.printed_words import unread_views, words_of_objects
from rtask.engine.perception.identity import recognise
from rtask.engine.perception.observation import OptionalLook, observe
from rtask.errors import MissingExtraError, UsageError
from rtask.rdf.namespaces import PREFIXES, RT
from tests.features.words.printed_cartons import StandInReader, carton, photograph
from tests.rtask.engine.conftest import registration

pytestmark = pytest.mark.slow


def look(flavour, seed, brand=0):
    """Return a photograph of a carton as a request carries it."""
    image, box = photograph(carton(flavour, brand), seed)
    quality = [cv2.IMWRITE_JPEG_QUALITY, 95]
    return {"image": cv2.imencode(".jpg", image[..., ::-1], quality)[1].tobytes(), "box": box}


def store(engine, name="vanilla", flavour="VANILJ", seed=0, brand=0):
    item = {**look(flavour, seed, brand), "name": name, "merge": False}
    return engine.call("insert_object", {"objects": [item]})["objects"][0]


@pytest.fixture
def reading():
    """Yield an engine that reads words, in memory, and its reader."""
    reader = StandInReader()
    with rtask.open(":memory:", reason=False) as kb, Engine(kb, reader=reader) as engine:
        yield engine, reader


def test_a_sibling_that_says_another_word_is_not_the_object(reading):
    engine, _ = reading
    vanilla = store(engine)
    assert engine.call("search_object", look("VANILJ", 7))["accepted"]
    other = engine.call("search_object", look("NATURELL", 8))
    assert not other["accepted"]
    assert (other["outcome"], other["family"]) == ("multiple", vanilla["object"])
    assert (other["word_seen"], other["word_stored"]) == ("NATURELL", "VANILJ")
    assert other["message"] == (
        'looks like vanilla, but says "NATURELL" where vanilla says "VANILJ"'
    )
    assert other["similar_objects"][0]["confidence"] <= 0.5
    # Nor does a new view of the sibling become one of the object.
    new = engine.call("insert_object", {"objects": [look("NATURELL", 9)]})["objects"][0]
    assert new["new"]


def test_without_a_reader_the_sibling_is_taken_for_the_object(kb):
    with Engine(kb) as engine:
        assert engine.context.words is None
        store(engine)
        other = engine.call("search_object", look("NATURELL", 8))
        assert other["accepted"]
        assert other["word_seen"] == ""
        assert other["message"] == "is vanilla"
        assert not kb.match(None, RT.readBy)


def test_what_is_read_doubtfully_is_no_veto(reading):
    engine, reader = reading
    store(engine)
    reader.score = 0.7
    assert engine.call("search_object", look("NATURELL", 8))["accepted"]


def test_one_look_that_shows_another_word_outweighs_others_that_hide_it(reading):
    engine, _ = reading
    store(engine)
    looks = [look("VANILJ", 7), look("VANILJ", 11)]
    assert engine.call("search_object", {**looks[0], "looks": looks[1:]})["accepted"]
    mixed = engine.call("search_object", {**looks[0], "looks": [looks[1], look("NATURELL", 8)]})
    assert not mixed["accepted"]
    assert mixed["word_seen"] == "NATURELL"


def test_a_word_refutes_where_nothing_else_points_to_a_sibling(reading):
    engine, _ = reading
    store(engine)
    context = engine.context
    seen = observe(OptionalLook(**look("NATURELL", 8)))
    found = recognise(context.views.recogniser, seen, context.policy, 8)
    alone = replace(found.matches[0], difference=None)
    weighed = context.words.weigh(replace(found, matches=(alone,)), seen)
    assert found.accepted
    assert not weighed.accepted
    assert weighed.words.seen.text == "NATURELL"


def test_a_picture_is_read_once_for_a_question_and_a_report(reading):
    engine, reader = reading
    store(engine)
    before = reader.pictures
    seen = look("NATURELL", 8)
    engine.call("search_object", seen)
    engine.call("search_object", seen)
    engine.call("insert_object", {"objects": [seen]})
    assert reader.pictures == before + 1


def test_words_are_facts_with_place_and_score_in_the_graph_of_their_view(reading):
    engine, _ = reading
    stored = store(engine)
    rows = engine.kb.select(f"""{PREFIXES}
SELECT ?text ?token ?score ?u ?length ?by ?g WHERE {{
  GRAPH ?g {{ <{stored["view"]}> rt:viewContent ?reading . ?reading rt:readBy ?by ; rt:hasWord ?w }}
  ?w rt:wordText ?text ; rt:wordToken ?token ; rt:readingScore ?score ; rt:wordU ?u ;
    rt:wordLength ?length }}""")
    assert [(row.value("text"), row.value("token"), row.value("by")) for row in rows] == [
        ("VANILJ", "vanilj", "stand-in 1")
    ]
    row = rows[0]
    assert row.value("score") == pytest.approx(0.97)
    assert row.value("length") == pytest.approx(160)
    of_view = [q.graph_name for q in engine.kb.match(None, RT.hasView)]
    assert row["g"] in of_view
    assert not [v for v in engine.kb.validate() if "Word" in str(v) or "Reading" in str(v)]


def test_objects_are_found_by_what_they_say(reading):
    engine, _ = reading
    vanilla = store(engine)["object"]
    plain = store(engine, "plain", "NATURELL", seed=3, brand=5)["object"]
    hits = engine.kb.search("naturell", cls=RT.ManipulableObject)
    assert [(hit.subject.value, hit.text) for hit in hits] == [(plain, "NATURELL")]
    engine.call("register_robot", registration("nao-1", "hand"))
    wanted = engine.call(
        "resolve_request", {"wanted": "the thing that says naturell", "gripper_id": "hand"}
    )
    assert [one["object"] for one in wanted["objects"]] == [plain]
    assert wanted["understood"]["printed"] == ["naturell"]
    assert 'that says "naturell"' in wanted["explanation"]["text"]
    told = answer(engine.kb, "Where is the thing that says vanilj?")
    assert vanilla in str(told.sparql)
    assert plain not in str(told.sparql)


def test_words_go_with_the_view_that_is_forgotten(reading):
    engine, _ = reading
    vanilla = store(engine)["object"]
    assert words_of_objects(engine.kb, [vanilla])
    engine.call("curate_object", {"operation": "forget", "object": vanilla})
    assert not engine.kb.match(None, RT.wordText)
    assert not engine.kb.match(None, RT.readBy)
    assert engine.kb.search("vanilj") == []


def test_views_stored_before_are_read_once_by_a_command(tmp_path):
    folder = tmp_path / "store"
    with rtask.open(folder, reason=False) as kb, Engine(kb) as engine:
        vanilla = store(engine)["object"]
        store(engine, "bare", "", seed=4, brand=5)
        assert len(unread_views(kb)) == 2
        with pytest.raises(UsageError, match="RTASK_WORDS=1"):
            engine.read_words()
    reader = StandInReader()
    with rtask.open(folder, reason=False) as kb, Engine(kb, reader=reader) as engine:
        done = []
        assert engine.read_words(lambda number, of: done.append((number, of))) == (2, 1, 0)
        assert done == [(1, 2), (2, 2)]
        (words,) = words_of_objects(kb, [vanilla]).values()
        assert [word.text for word in words] == ["VANILJ"]
        assert unread_views(kb) == []  # nor is the view without a word read again
        assert engine.read_words() == (0, 0, 0)
        assert reader.pictures == 2
        assert not engine.call("search_object", look("NATURELL", 8))["accepted"]


def test_a_picture_on_which_the_reader_fails_is_stored_unread(reading):
    engine, reader = reading

    def failing(rgb):
        raise ValueError("the network gave nothing")

    read, reader.read = reader.read, failing
    store(engine)
    assert engine.call("search_object", look("NATURELL", 8))["accepted"]
    assert len(unread_views(engine.kb)) == 1
    assert engine.read_words() == (0, 0, 1)
    reader.read = read
    assert engine.read_words() == (1, 1, 0)
    assert not engine.call("search_object", look("NATURELL", 9))["accepted"]


def test_reading_is_switched_on_by_name_and_names_its_extra(kb, monkeypatch):
    monkeypatch.setenv("RTASK_WORDS", "yes")
    with pytest.raises(UsageError, match="RTASK_WORDS is 'yes': 1 to read words"):
        Engine(kb)
    monkeypatch.setenv("RTASK_WORDS", "1")
    monkeypatch.setitem(__import__("sys").modules, "rapidocr", None)
    with pytest.raises(MissingExtraError, match=r"needs the extra 'words': .*pip install"):
        Engine(kb)
    monkeypatch.setenv("RTASK_WORDS", "0")
    Engine(kb).close()
