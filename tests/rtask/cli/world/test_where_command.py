"""`rtask where`: where something is, by name, at a time."""

from __future__ import annotations

import json

import pytest

import rtask
from rtask.cli import main
from rtask.rdf.namespaces import PREFIXES

BASE = "https://example.org/kb/"


@pytest.fixture
def store(tmp_path):
    with rtask.open(tmp_path / "kb", base=BASE, reason=False) as kb:
        kb.update(f"""{PREFIXES}
INSERT DATA {{ GRAPH <{BASE}graph/shared> {{
  <{BASE}object/1> a rt:Mug ; rt:objectId "lab/1" ; rt:name "blue cup" .
  <{BASE}thing/1> a rt:Exemplar ; rt:exemplarOf <{BASE}object/1> .
  <{BASE}place/1> a rt:SupportSurface ; rt:name "shelf" .
  <{BASE}placement/1> a rt:Placement ; rt:placementOf <{BASE}thing/1> ;
    rt:placedOn <{BASE}place/1> ;
    time:hasBeginning <{BASE}placement/1/begin> ; time:hasEnd <{BASE}placement/1/end> .
  <{BASE}placement/1/begin> time:inXSDDateTimeStamp "2026-01-01T10:00:00Z"^^xsd:dateTimeStamp .
  <{BASE}placement/1/end> time:inXSDDateTimeStamp "2026-01-01T11:00:00Z"^^xsd:dateTimeStamp
}} }}""")
    return str(tmp_path / "kb")


def run(capsys, *arguments):
    """Return the exit code and what was printed."""
    with pytest.raises(SystemExit) as ended:
        main(["where", *arguments])
    printed = capsys.readouterr()
    return ended.value.code or 0, printed.out, printed.err


def test_a_place_at_a_time_and_not_known_since(store, capsys):
    code, out, _ = run(capsys, "blue cup", "--at", "2026-01-01T10:30:00Z", "-d", store)
    assert (code, out.startswith("blue cup: on shelf")) == (0, True)
    code, out, _ = run(capsys, "blue cup", "-d", store)
    assert code == 1
    assert "not known, last on or in shelf until 2026-01-01 11:00:00 UTC" in out
    code, out, _ = run(capsys, "mug", "--at", "2026-01-01T10:30:00Z", "--json", "-d", store)
    answer = json.loads(out)
    assert (code, answer["known"], answer["things"][0]["place_label"]) == (0, True, "shelf")


def test_a_name_that_nothing_has_is_not_known(store, capsys):
    assert run(capsys, "red cup", "-d", store)[:2] == (
        1, 'not known: nothing is called "red cup"\n',
    )  # fmt: skip


@pytest.mark.parametrize(
    ("wrong", "words"),
    [(("--at", "noon"), "'noon' is not a time"), (("--frame", "attic"), "no frame 'attic'"),
     (("--near", "shelv"), "did you mean"), (("--radius", "0"), "radius")],
)  # fmt: skip
def test_a_wrong_question_says_what_is_wrong(store, capsys, wrong, words):
    code, _, err = run(capsys, "blue cup", *wrong, "-d", store)
    assert code != 0
    assert words in err
