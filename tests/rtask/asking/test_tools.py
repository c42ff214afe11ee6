"""Tools of agents: their texts, their answers, and what a caller learns that knows these alone."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator
from typing import Any

import pytest
from jsonschema import Draft202012Validator

import ontology
import rtask
from rtask.asking.tools import resources
from rtask.asking.tools.protocol import VERSIONS, answer
from rtask.asking.tools.toolbox import MAX_RESULT, TOOLS, Toolbox
from rtask.engine import Engine
from rtask.engine.context import SCOPES
from rtask.errors import UnsupportedError
from rtask.kb.commit.access import Access
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import prologue
from tests.rtask.asking.scripted_caller import ScriptedCaller, Waiting

SITE = "http://lab.example"
ROBOT = Access("nao", "robot")
NAMES = [
    "ask", "ask_sparql", "check_sparql", "search", "describe", "explain", "history", "where_is",
    "recall_grasps", "find_object", "propose_change",
]  # fmt: skip
SAMPLE = "https://w3id.org/rtask-kg/kb/sample/"


@pytest.fixture(scope="module")
def toolbox(kb: KnowledgeBase) -> Iterator[Toolbox]:
    engine = Engine(kb)
    yield Toolbox(kb, engine, lambda access: SCOPES[access.role])
    engine.close()


@pytest.fixture(scope="module")
def tools(toolbox: Toolbox) -> dict[str, Any]:
    return {tool["name"]: tool for tool in toolbox.listed(ROBOT)}


def call(toolbox: Toolbox, name: str, **arguments: Any) -> dict[str, Any]:
    """Return the data of a call that succeeds, after comparing it with the schema."""
    result = toolbox.call(name, arguments, ROBOT, SITE, Waiting())
    assert not result["isError"], result
    document: dict[str, Any] = result["structuredContent"]
    (tool,) = (tool for tool in toolbox.listed(ROBOT) if tool["name"] == name)
    Draft202012Validator(tool["outputSchema"]).validate(document)
    assert len(json.dumps(result, ensure_ascii=False).encode()) <= MAX_RESULT
    assert json.loads(result["content"][0]["text"]) == document
    return document


def failure(toolbox: Toolbox, name: str, **arguments: Any) -> dict[str, Any]:
    result = toolbox.call(name, arguments, ROBOT, SITE, Waiting())
    assert result["isError"]
    document: dict[str, Any] = json.loads(result["content"][0]["text"])
    return document


def test_a_dozen_tools_take_twelve_kilobytes(tools: dict[str, Any]) -> None:
    """So many as an agent gets them: clients of the official SDK write what is left out as null."""
    assert list(tools) == NAMES
    as_read = [
        {
            **tool, "title": None, "icons": None, "execution": None, "_meta": None,
            "annotations": {
                **tool["annotations"], "title": None, "destructiveHint": None,
                "idempotentHint": None, "openWorldHint": None,
            },
        }
        for tool in tools.values()
    ]  # fmt: skip
    assert len(json.dumps(as_read, separators=(",", ":")).encode()) <= 12_000


@pytest.mark.parametrize("name", NAMES)
def test_a_tool_is_a_sentence_two_examples_and_schemas_that_fit(
    tools: dict[str, Any], name: str
) -> None:
    tool, declared = tools[name], TOOLS[name]
    request = Draft202012Validator(tool["inputSchema"])
    for schema in (tool["inputSchema"], tool["outputSchema"]):
        Draft202012Validator.check_schema(schema)
        assert schema["type"] == "object"
    assert declared.sentence.count(". ") == 0
    assert len(declared.examples) == 2
    for example in declared.examples:
        request.validate(example)
        assert json.dumps(example) in tool["description"]
    for member in tool["inputSchema"]["properties"].values():
        if "default" in member:
            Draft202012Validator(member).validate(member["default"])


def test_effects_follow_from_declarations(tools: dict[str, Any], toolbox: Toolbox) -> None:
    hints = {name: tool["annotations"]["readOnlyHint"] for name, tool in tools.items()}
    assert {name for name, only_reads in hints.items() if not only_reads} == {"propose_change"}
    assert toolbox.effect_of("propose_change") == "writes"
    assert toolbox.effect_of("recall_grasps") == toolbox.effect_of("no such tool") == "reads"


def test_a_reader_gets_no_tool_that_writes(toolbox: Toolbox) -> None:
    reader = Access(role="reader")
    assert "propose_change" not in toolbox.names(reader)
    refused = toolbox.call("propose_change", {}, reader, SITE, Waiting())
    assert json.loads(refused["content"][0]["text"])["error"] == "graph-forbidden"


def test_terms_go_in_as_they_come_out(toolbox: Toolbox, kb: KnowledgeBase) -> None:
    found = call(toolbox, "search", words="mug blue")["hits"]
    assert found[0]["iri"] == "kb:object/7"
    query = f"SELECT ?name {{ {found[0]['iri']} rt:name ?name }}"
    answered = call(toolbox, "ask_sparql", query=query)
    assert answered["rows"][0][0]["value"] == 'the 5" mug, blue'
    assert answered["commit"] == kb.seq
    described = call(toolbox, "describe", term=found[0]["iri"])
    by_property = {fact["p"]: fact for fact in described["facts"]}
    assert by_property["rt:name"]["o"]["by"] == by_property["rt:name"]["by"] == ["shared"]
    assert by_property["rdf:type"]["proof"].startswith(f"{SITE}/explain?s=kb:object/7&p=rdf:type")
    assert "?thing a rt:Mug" in call(toolbox, "describe", term="rt:Mug")["example"]
    assert described["example"] == ""
    assert call(toolbox, "describe", term='the 5" mug, blue')["term"] == "kb:object/7"


def test_a_predicate_that_nothing_declares_is_not_unknown() -> None:
    with rtask.open(":memory:", base="urn:lab/", reason=False) as graph:
        assert isinstance(graph, KnowledgeBase)
        graph.update("INSERT DATA { <urn:lab/a> <urn:lab/seen> 1 . <urn:lab/b> <urn:lab/seen> 2 }")
        engine = Engine(graph)
        own = Toolbox(graph, engine, lambda access: SCOPES[access.role])
        described = call(own, "describe", term="kb:seen")
        engine.close()
    assert (described["kind"], described["count"], described["example"]) == ("property", 2, "")


def test_a_query_comes_back_with_its_certain_faults_and_a_repair(toolbox: Toolbox) -> None:
    query = "SELECT ?g {\n kb:object/7 rt:hasGrsp ?g }"
    answered = call(toolbox, "ask_sparql", query=query)
    fault = answered["faults"][0]
    assert (fault["severity"], fault["line"], fault["column"]) == ("certain", 2, 14)
    assert "rt:hasGrasp ?g" in fault["repaired"]["value"]
    assert not call(toolbox, "check_sparql", query=query)["ok"]
    broken = failure(toolbox, "ask_sparql", query="SELECT ?g {\n kb:object/7 rt:hasGrasp g }")
    assert (broken["error"], broken["line"], broken["column"]) == ("query-syntax", 2, 26)


def test_a_long_answer_says_how_to_get_the_rest(toolbox: Toolbox) -> None:
    query = "SELECT ?c { ?c a owl:Class . FILTER(isIRI(?c)) } ORDER BY ?c"
    rows: list[Any] = []
    offset = 0
    while True:
        page = call(toolbox, "ask_sparql", query=query, offset=offset)
        rows += page["rows"]
        if "more" not in page:
            break
        assert page["more"]["offset"] == len(rows)
        offset = page["more"]["offset"]
    names = [row[0]["value"] for row in rows]
    assert len(names) == len(set(names)) > 100


def test_why_has_three_answers(toolbox: Toolbox) -> None:
    about = {"s": f"<{SAMPLE}mug>", "p": "a", "o": "rt:DrinkingVessel"}
    holds = call(toolbox, "explain", **about)
    assert (holds["verdict"], holds["steps"][0]["depth"]) == ("holds", 0)
    assert any(step["rule"] == "asserted" for step in holds["steps"])
    lacks = call(toolbox, "explain", **{**about, "s": f"<{SAMPLE}pen>"})
    assert lacks["verdict"] == "does not hold"
    assert lacks["needs"]
    undecided = call(toolbox, "explain", **about, budget=1)
    assert (undecided["verdict"], undecided["try_budget"] > 1) == ("not decided", True)


def test_the_past_of_a_term_and_its_state_after_a_commit(
    toolbox: Toolbox, kb: KnowledgeBase
) -> None:
    before = kb.seq
    mass = "https://w3id.org/rtask-kg/ns#mass"
    kb.update(f"INSERT DATA {{ <urn:lab/object/9> <{mass}> 0.2e0 }}", agent="nao", note="weighed")
    latest = call(toolbox, "history", term="kb:object/9")["commits"][0]
    assert (latest["by"], latest["note"]["value"]) == ("nao", "weighed")
    assert latest["plus"][0]["o"] == {"type": "number", "value": 0.2}
    about = {"s": "kb:object/9", "p": "rt:mass", "o": str(latest["plus"][0]["o"]["value"])}
    assert call(toolbox, "explain", **about)["verdict"] == "holds"
    then = call(toolbox, "history", term="kb:object/9", at=before)["facts"]
    now = call(toolbox, "history", term="kb:object/9", at=kb.seq)["facts"]
    assert {fact["p"] for fact in now} - {fact["p"] for fact in then} == {"rt:mass"}
    assert failure(toolbox, "history", term="kb:object/9", at=kb.seq + 1)["error"] == "usage"


def test_a_place_has_its_frame_time_and_author(toolbox: Toolbox) -> None:
    latest = call(toolbox, "where_is", object="mug")["places"][0]
    assert latest["frame_id"]["value"] == "camera_depth_optical_frame"
    assert latest["why"].startswith(f"{SITE}/resource?iri=")
    assert (latest["position"], latest["confidence"]) == ([0.5, 0.0, 0.8], 0.9)
    assert latest["time"] == "2026-01-01T10:00:00Z"
    assert latest["by"].endswith("pr2>")
    assert not call(toolbox, "where_is", object="kb:object/9")["stated"]


def test_the_places_of_a_product_are_those_of_its_things(monkeypatch: pytest.MonkeyPatch) -> None:
    with rtask.open(":memory:", base="urn:lab/") as kb, Engine(kb) as engine:
        kb.update(
            prologue(ontology.PREFIXES)
            + """INSERT DATA { <urn:lab/cup> a rt:Cup ; rt:objectId "lab/1" ; rt:name "red cup" .
            <urn:lab/thing/1> a rt:Exemplar ; rt:exemplarOf <urn:lab/cup> .
            <urn:lab/thing/2> a rt:Exemplar ; rt:exemplarOf <urn:lab/cup> .
            <urn:lab/q> a rt:Placement ; rt:placementOf <urn:lab/thing/2> ;
                rt:placedOn <urn:lab/shelf> ; time:hasBeginning <urn:lab/begin> .
            <urn:lab/p> a rt:Placement ; rt:placementOf <urn:lab/thing/1> ;
                rt:placedOn <urn:lab/shelf> ; time:hasBeginning <urn:lab/begin> .
            <urn:lab/begin> a time:Instant ;
                time:inXSDDateTimeStamp "2026-01-01T10:00:00Z"^^xsd:dateTimeStamp .
            <urn:lab/shelf> a rt:SupportSurface ; rt:name "shelf" }"""
        )
        tools = Toolbox(kb, engine, lambda access: SCOPES[access.role])
        places = call(tools, "where_is", object="red cup")["places"]
        assert "on" in {place["relation"] for place in places}
        assert {place["thing"] for place in places} == {"kb:thing/1", "kb:thing/2"}
        monkeypatch.setattr("rtask.asking.tools.grasping.MAX_PLACES", 1)
        first = call(tools, "where_is", object="red cup")
        assert (len(first["places"]), first["more"]["left"]) == (1, 1)
        second = call(tools, "where_is", object="red cup", offset=first["more"]["offset"])
        assert first["places"] + second["places"] == places[:2]


def test_grasps_are_recalled_with_their_proofs_page_by_page(
    toolbox: Toolbox, monkeypatch: pytest.MonkeyPatch
) -> None:
    recalled = call(toolbox, "recall_grasps", object="mug")
    assert [grasp["gripper_type"] for grasp in recalled["grasps"]] == ["parallel_jaw_90"] * 2
    assert all("rt:hasGrasp" in grasp["proof"] for grasp in recalled["grasps"])
    assert all(f"{SITE}/feedback?grasp=" in grasp["why"] for grasp in recalled["grasps"])
    assert "more" not in recalled
    monkeypatch.setattr("rtask.asking.tools.grasping.PAGE", 1)
    first = call(toolbox, "recall_grasps", object="mug")
    assert (first["grasps"], first["more"]) == (recalled["grasps"][:1], {"offset": 1, "left": 1})
    assert (
        call(toolbox, "recall_grasps", object="mug", offset=1)["grasps"] == recalled["grasps"][1:]
    )


def test_a_change_is_tried_proposed_and_not_made(toolbox: Toolbox, kb: KnowledgeBase) -> None:
    before = kb.seq
    ill = [["kb:object/8", "rt:mass", "-3"]]
    tried = call(toolbox, "propose_change", add=ill, keep=False)
    assert (tried["possible"], tried["proposal"], tried["state"]) == (True, 0, "not kept")
    assert any("mass" in one["value"] for one in tried["violations"])
    wrong = call(
        toolbox, "propose_change", add=[["kb:object/8", "owl:differentFrom", "kb:object/8"]]
    )
    assert (wrong["possible"], wrong["proposal"]) == (False, 0)
    assert "contradicts" in wrong["refused"]["value"]
    other = "urn:lab/graph/agent/pr2"
    proposed = call(
        toolbox, "propose_change", add=[["kb:object/8", "a", "rt:Cup"]], graph=other, reason="seen"
    )
    assert kb.seq == before
    kept = kb.proposals.get(proposed["proposal"])
    assert (kept.author, kept.reason, kept.state) == ("nao", "seen", "proposed")
    assert other in kept.added
    assert failure(toolbox, "propose_change")["error"] == "usage"


def test_an_error_quotes_as_data_only(toolbox: Toolbox, kb: KnowledgeBase) -> None:
    refused = failure(toolbox, "describe", term='"twin"')
    assert refused["detail"]["type"] == "text"
    assert "kb" not in refused["advice"]
    assert "object/8" in refused["detail"]["value"]


@pytest.mark.parametrize("file", ontology.queries(), ids=lambda file: file.stem)
def test_a_scripted_caller_answers_the_questions_about_the_sample(
    toolbox: Toolbox, kb: KnowledgeBase, file: Any
) -> None:
    text = file.read_text()
    question = text.splitlines()[0].removeprefix("# question: ")
    rows, calls = ScriptedCaller(toolbox, ROBOT).answer(question)
    asked = kb.select(text)
    assert calls <= 3
    assert len(rows) == len(asked)
    expected = [line for line in text.splitlines() if line.startswith("# expected: ")]
    has_others = any("object/" in str(row) or "robot/" in str(row) for row in asked)
    if expected and not has_others and file.stem != "cq26":  # which counts this graph's own things
        listed = expected[0].removeprefix("# expected: ").split("; ")
        assert sorted(rows) == sorted(tuple(shlex.split(row)) for row in listed)


@pytest.mark.parametrize("file", ontology.episode_queries(), ids=lambda file: file.stem)
def test_a_scripted_caller_answers_the_questions_about_episodes(
    toolbox: Toolbox, kb: KnowledgeBase, file: Any
) -> None:
    text = file.read_text()
    question = text.splitlines()[0].removeprefix("# question: ")
    rows, calls = ScriptedCaller(toolbox, ROBOT).answer(question)
    assert calls <= 3
    assert len(rows) == len(kb.select(text))


def test_a_question_in_other_words_is_answered_by_the_nearest_one(toolbox: Toolbox) -> None:
    answered = call(toolbox, "ask", text="what is there to drink from?")
    assert answered["understood"] == "cq24"
    assert "drinkFrom" in answered["sparql"]
    assert answered["rows"]


def test_a_question_that_none_is_near_to_gets_the_nearest_and_no_rows(toolbox: Toolbox) -> None:
    answered = call(toolbox, "ask", text="will it rain on the moon tomorrow")
    assert answered.get("rows", []) == []
    assert not answered.get("understood")
    assert len(answered["questions"]) == 3


def request(toolbox: Toolbox, method: str, **params: Any) -> dict[str, Any]:
    message = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
    return answer(toolbox, message, ROBOT, SITE, Waiting())


@pytest.mark.parametrize("version", VERSIONS)
def test_either_version_is_spoken(toolbox: Toolbox, version: str) -> None:
    greeted = request(toolbox, "initialize", protocolVersion=version)["result"]
    assert greeted["protocolVersion"] == version
    assert set(greeted["capabilities"]) == {"tools", "resources"}
    assert request(toolbox, "initialize")["result"]["protocolVersion"] == VERSIONS[0]


def test_the_ontology_is_a_resource_of_six_kilobytes(toolbox: Toolbox, kb: KnowledgeBase) -> None:
    listed = request(toolbox, "resources/list")["result"]["resources"]
    assert len(listed) == 1 + len(ontology.queries()) + len(ontology.episode_queries())
    read = request(toolbox, "resources/read", uri=listed[0]["uri"])["result"]["contents"][0]
    assert len(read["text"].encode()) <= resources.MAX_ONTOLOGY
    assert "hasGrasp>GraspConfiguration" in read["text"]
    query = request(toolbox, "resources/read", uri="rtask:/questions/cq04")["result"]["contents"][0]
    assert query["mimeType"] == "application/sparql-query"
    assert len(kb.select(query["text"])) >= 2


def test_a_proof_is_a_resource_at_its_address(toolbox: Toolbox) -> None:
    about = {"s": f"<{SAMPLE}mug>", "p": "a", "o": "rt:DrinkingVessel"}
    address = call(toolbox, "explain", **about)["proof"]
    read = request(toolbox, "resources/read", uri=address)["result"]["contents"][0]
    assert json.loads(read["text"])["verdict"] == "holds"
    assert request(toolbox, "resources/read", uri="rtask:/x")["error"]["code"] == -32002


def test_what_is_no_request_is_an_error_of_the_protocol(toolbox: Toolbox) -> None:
    assert request(toolbox, "tools/call", name="fly")["error"]["code"] == -32602
    assert request(toolbox, "prompts/list")["error"]["code"] == -32601
    odd = answer(toolbox, {"id": [1], "method": "ping"}, ROBOT, SITE, Waiting())
    assert (odd["id"], odd["error"]["code"]) == (None, -32600)


def test_what_lies_beyond_a_limit_is_said_and_can_be_asked_for(
    toolbox: Toolbox, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A list that ends at its limit reads as all there is."""
    tries: list[tuple[str, str, dict[str, Any]]] = [
        ("rtask.asking.tools.lookup.MAX_HITS", "hits", {"words": "grasp*"}),
        ("rtask.asking.tools.lookup.MAX_FACTS", "facts", {"term": "rt:Mug"}),
        ("rtask.asking.tools.proofs.MAX_COMMITS", "commits", {"term": "kb:object/7"}),
    ]
    for (limit, entries, arguments), name in zip(
        tries, ("search", "describe", "history"), strict=True
    ):
        whole = call(toolbox, name, **arguments)[entries]
        with monkeypatch.context() as lowered:
            lowered.setattr(limit, 1)
            first = call(toolbox, name, **arguments)
            assert first[entries] == whole[:1], name
            if len(whole) > 1:
                assert first["more"]["offset"] == 1
                assert first["more"]["left"] >= 1
                second = call(toolbox, name, **arguments, offset=1)
                assert second[entries] == whole[1:2], name


def test_the_past_says_from_which_commit_on_it_is_kept(
    toolbox: Toolbox, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert call(toolbox, "history", term="kb:object/7")["kept_from"] == kb.feed.oldest_retained()
    monkeypatch.setattr(kb.feed, "oldest_retained", lambda: kb.seq)
    assert call(toolbox, "history", term="kb:object/7")["kept_from"] == kb.seq
    assert failure(toolbox, "history", term="kb:object/7", at=1)["error"] == "changes-gone"


def test_no_page_of_grasps_is_given_twice(
    toolbox: Toolbox, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beyond the last page that there is, the caller is told, and told how to go on."""
    monkeypatch.setattr("rtask.asking.tools.grasping.MAX_GRASPS", 1)
    first = call(toolbox, "recall_grasps", object="mug")
    assert (len(first["grasps"]), first["more"]) == (1, {"offset": 1, "left": 1})
    refused = failure(toolbox, "recall_grasps", object="mug", offset=1)
    assert refused["error"] == "usage"
    assert "rt:hasGrasp" in refused["detail"]["value"] or "#hasGrasp>" in refused["detail"]["value"]


def test_faults_violations_and_authors_that_are_left_out_are_counted(
    toolbox: Toolbox, kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    query = "SELECT ?a ?b { ?a a rt:Mugg . ?b a rt:Cupp }"
    whole = call(toolbox, "ask_sparql", query=query)
    assert "faults_left_out" not in whole
    count = len(whole["faults"]) - 1
    ill = [["kb:object/8", "rt:mass", "-3"], ["kb:object/9", "rt:mass", "-3"]]
    with monkeypatch.context() as lowered:
        lowered.setattr("rtask.asking.tools.query.MAX_FINDINGS", 1)
        lowered.setattr("rtask.asking.tools.changes.MAX_SHOWN", 1)
        assert call(toolbox, "ask_sparql", query=query)["faults_left_out"] == count
        checked = call(toolbox, "check_sparql", query=query)
        assert (checked["ok"], checked["not_checked"]) == (False, "")
        assert checked["faults_left_out"] >= count >= 1
        tried = call(toolbox, "propose_change", add=ill, keep=False)
        assert (len(tried["violations"]), tried["violations_left_out"] > 0) == (1, True)
    for name in "abcde":
        said = f'<urn:lab/object/7> <{ontology.PREFIXES["rdfs"]}comment> "often said"'
        kb.update(f"INSERT DATA {{ {said} }}", agent=name)
    (fact,) = (
        fact
        for fact in call(toolbox, "describe", term="kb:object/7")["facts"]
        if fact["o"]["value"] == "often said"
    )
    assert fact["by"] == fact["o"]["by"] == ["a", "b", "c", "and 2 more"]


def test_a_query_that_is_not_read_is_not_called_right(
    toolbox: Toolbox, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unread(text: str, base: str) -> Any:
        raise UnsupportedError("a form of its own")

    monkeypatch.setattr("rtask.asking.check.checker.read_outline", unread)
    checked = call(toolbox, "check_sparql", query="SELECT ?o { ?o a rt:Mugg }")
    assert (checked["ok"], checked["faults"]) == (True, [])
    assert checked["not_checked"].startswith("not checked")
