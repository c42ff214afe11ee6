"""Wherever a command takes an IRI, it takes every form in which people have it, and a name."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.cli import main
from rtask.rdf.namespaces import PREFIXES
from tests.rtask.cli.each.tree import walk_commands

pytestmark = pytest.mark.slow

_MUG = ("urn:lab/object/1", "<urn:lab/object/1>", "kb:object/1", "blue mug", '"blue mug"')
_VIEW = ("urn:lab/view/1", "<urn:lab/view/1>", "kb:view/1")
_GRAPH = ("urn:lab/graph/shared", "<urn:lab/graph/shared>", "kb:graph/shared")
_ONTOLOGY = ("urn:lab/onto", "<urn:lab/onto>", "kb:onto", "own one")
_MODULE = (f"{ontology.ONTOLOGY}/grasp", "grasp")
_CLASS = (f"{ontology.NS}Mug", f"<{ontology.NS}Mug>", "rt:Mug", "mug")
_RULE = ("urn:lab/rule/first", "<urn:lab/rule/first>", "kb:rule/first", "first", "'first'")
_PLACE = ("urn:lab/place/1", "<urn:lab/place/1>", "kb:place/1", "shelf")
_OTHER = ("urn:lab/x", "<urn:lab/x>", "kb:x")
_TERMS: dict[tuple[str, str], tuple[tuple[str, ...], str]] = {
    ("ask", "objects"): (_MUG, "ask mug --gripper jaw --object {}"),
    ("ask", "gripper"): (_OTHER, "ask mug --gripper {}"),
    ("contributors list", "name"): (_OTHER, "contributors list {}"),
    ("contributors withdraw", "name"): (_OTHER, "contributors withdraw {}"),
    ("entails", "conclusion"): (_MUG, "entails {} a rt:Container"),
    ("explain", "subject"): (_MUG, "explain {} a rt:Mug"),
    ("explain", "predicate"): (
        (f"{ontology.NS}name", f"<{ontology.NS}name>", "rt:name"),
        'explain kb:object/1 {} "blue%mug"',
    ),
    ("explain", "value"): (_CLASS, "explain kb:object/1 a {}"),
    ("export", "graphs"): (_GRAPH, "export out.nt --graph {}"),
    ("feedback", "grasp"): (_OTHER, "feedback --with-grasp {}"),
    ("feedback", "object"): (_MUG, "feedback --object {}"),
    ("feedback", "robot"): (_OTHER, "feedback --robot {}"),
    ("grasp push", "source"): (_MUG, "grasp push {}"),
    ("grasp space", "source"): (_MUG, "grasp space {}"),
    ("history", "subject"): (_MUG, "history {}"),
    ("history", "graph"): (_GRAPH, "history --graph {}"),
    ("load", "graph"): (_GRAPH, "load own.ttl --json --dry-run --graph {}"),
    ("objects forget", "name"): (_MUG, "objects forget {}"),
    ("objects forget", "views"): (_VIEW, "objects forget kb:object/1 {}"),
    ("objects merge", "name"): (_MUG, "objects merge {} kb:object/2"),
    ("objects merge", "into"): (_MUG, "objects merge kb:object/2 {}"),
    ("objects mesh", "name"): (_MUG, "objects mesh {}"),
    ("objects name", "name"): (_MUG, "objects name {} --as cup"),
    ("objects show", "name"): (_MUG, "objects show {}"),
    ("objects split", "name"): (_MUG, "objects split {} kb:view/1"),
    ("objects split", "views"): (_VIEW, "objects split kb:object/1 {}"),
    ("ontology path", "iri"): (_MODULE, "ontology path {}"),
    ("ontology show", "name"): (_CLASS, "ontology show {}"),
    ("ontology unload", "iri"): (_ONTOLOGY, "ontology unload --dry-run {}"),
    ("ontology upgrade", "source"): (_ONTOLOGY, "ontology upgrade --undo {}"),
    ("quarantine", "records"): (_OTHER, "quarantine --forget {}"),
    ("questions answer", "question"): (_OTHER, "questions answer {} 1"),
    ("rules remove", "names"): (_RULE, "rules remove {}"),
    ("rules show", "name"): (_RULE, "rules show {}"),
    ("search", "cls"): (_CLASS, "search blue --class {}"),
    ("tasks cancel", "plan"): (_OTHER, "tasks cancel --reason late {}"),
    ("tasks tree", "plan"): (_OTHER, "tasks tree {}"),
    ("token create", "rights"): (_GRAPH, "token create --role reader --right read:{}"),
    ("where", "frame"): (_OTHER, "where kb:object/1 --at 2026-01-01T10:30:00Z --frame {}"),
    ("where", "name"): (_MUG, "where {} --at 2026-01-01T10:30:00Z"),
    ("world export", "frame"): (_OTHER, "world export scene.glb --frame {}"),
    ("where", "near"): (_PLACE, "where kb:object/1 --at 2026-01-01T10:30:00Z --near {}"),
    ("why", "subject"): (_OTHER, "why {}"),
    ("simulate why", "subject"): (_OTHER, "simulate why {}"),
}
"""Parameters that take a term: forms of one term, and a call with a place for it."""
_OTHERS = {
    "words, remarks, queries and commands": """comment correct decline kind label message new_name
        note query reason remark request start_with text wanted words""",
    "names of robots, people and branches, which are no IRIs": """
        agent author branch hand keep robot role""",
    "names of services, datasets, versions and what belongs to them": """after arguments before
        key mapping method path paths rules services version where""",
    "numbers of commits, attempts and tokens": "commit commits task_id token_id",
    "times and languages": "at deadline end expires lang lifetime since start until",
    "files, formats and addresses": """allow_host allow_load allow_origin allow_service base
        classifier cluster cors follow form host new old ontology public_url server sources store
        target url""",
    "choices": "action kinds names only verdict gripper_type",
    "robots and ROS": """
        base_frame distortion eliminate frame gripper heights jaws joints limit look name
        namespace naoqi on operation prefix remaps ros_args rosbridge source tables topic""",
}
"""Other parameters that are texts, by what they take instead."""
_VARYING = re.compile(r'"seconds": [\d.e-]+|rtk_\w+|\b[0-9a-f]{12}\b|made \S+')
_CHANGING = ("objects forget", "objects merge", "objects name", "objects split", "rules remove")


def test_each_parameter_that_is_a_text_takes_terms_or_something_else() -> None:
    others = {name for names in _OTHERS.values() for name in names.split()}
    texts = {
        (command, parameter.name or ""): getattr(parameter, "help", None) or ""
        for command, loaded in walk_commands()
        for parameter in loaded.params
        if parameter.type.name == "text"
    }
    unclassified = {text for text in texts if text not in _TERMS and text[1] not in others}
    assert unclassified == set()
    assert _TERMS.keys() <= texts.keys()
    mentioning = {text for text, help in texts.items() if "IRI" in help.split()}
    assert mentioning <= _TERMS.keys()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("terms")
    (folder / "own.ttl").write_text(
        '<urn:lab/onto> a <http://www.w3.org/2002/07/owl#Ontology> ; '
        '<http://www.w3.org/2000/01/rdf-schema#label> "own one" .'
    )  # fmt: skip
    with rtask.open(folder / "kb", base="urn:lab/") as kb:
        kb.update(f"""{PREFIXES}
INSERT DATA {{ GRAPH <urn:lab/graph/shared> {{
  <urn:lab/object/1> a rt:Mug ; rt:objectId "1" ; rt:name "blue mug" ;
    rt:hasView <urn:lab/view/1>, <urn:lab/view/2> .
  <urn:lab/object/2> a rt:Mug ; rt:objectId "2" ; rt:name "red mug" .
  <urn:lab/view/1> a rt:View . <urn:lab/view/2> a rt:View .
  <urn:lab/thing/1> a rt:Exemplar ; rt:exemplarOf <urn:lab/object/1> .
  <urn:lab/place/1> a rt:SupportSurface ; rt:name "shelf" .
  <urn:lab/placement/1> a rt:Placement ; rt:placementOf <urn:lab/thing/1> ;
    rt:placedOn <urn:lab/place/1> ; time:hasBeginning <urn:lab/placement/1/begin> .
  <urn:lab/placement/1/begin> time:inXSDDateTimeStamp "2026-01-01T10:00:00Z"^^xsd:dateTimeStamp
}} }}""")
        kb.add_rules([rtask.Rule("first", "CONSTRUCT { ?a <urn:q> ?b } WHERE { ?a <urn:p> ?b }")])
        kb.load(str(folder / "own.ttl"))
    return folder


@pytest.fixture
def run(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def call(command: str, *arguments: str) -> str:
        """Return the exit code and all that was printed, of a copy where it may change."""
        folder = made / "kb"
        if command in _CHANGING:
            folder = tmp_path / "kb"
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(made / "kb", folder)
        where = ["--data", str(folder)] if command != "ontology path" else []
        with pytest.raises(SystemExit) as caught:
            main([*arguments, *where])
        out, err = capsys.readouterr()
        return f"{caught.value.code or 0}\n{_VARYING.sub('', out + err)}"

    return call


@pytest.mark.parametrize(("command", "parameter"), _TERMS, ids=lambda name: name.replace(" ", "-"))
def test_all_forms_of_a_term_mean_the_same(
    run: Callable[..., str], made: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, command: str, parameter: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    shutil.copy(made / "own.ttl", tmp_path)
    forms, call = _TERMS[command, parameter]
    printed = [
        run(command, *(word.replace("{}", form).replace("%", " ") for word in call.split()))
        for form in forms
    ]
    assert [text for text in printed if text != printed[0]] == []
    if command != "ask" and forms != _OTHER:
        assert "unknown" not in printed[0]
        assert not printed[0].startswith("2")
