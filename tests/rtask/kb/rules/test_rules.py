"""Rules of the user: stored with who and when, in force at once, explained by their label."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyoxigraph import NamedNode

import ontology
import rtask
from rtask import Rule
from rtask.errors import (
    ConflictError,
    ForbiddenError,
    InconsistentError,
    ParseError,
    UnknownTermError,
    UnsupportedError,
    UsageError,
)
from rtask.kb.commit.access import Access
from rtask.kb.rules.rule import parse_rules

PREFIX = f"PREFIX rt: <{ontology.NS}>\nPREFIX : <urn:t:>\n"
ABOVE = Rule("on is above", PREFIX + "CONSTRUCT { ?a :above ?b } WHERE { ?a :on ?b }")
CHAIN = Rule(
    "above is transitive",
    PREFIX + "CONSTRUCT { ?a :above ?c } WHERE { ?a :above ?b . ?b :above ?c }",
)
CLEAR = Rule(
    "nothing above is clear",
    PREFIX + "CONSTRUCT { ?a :clear true } WHERE { ?a :on ?b FILTER NOT EXISTS { ?c :above ?a } }",
)
STACK = "INSERT DATA { <urn:t:a> <urn:t:on> <urn:t:b> . <urn:t:b> <urn:t:on> <urn:t:c> }"


def pairs(kb: rtask.KnowledgeBase, predicate: str) -> list[str]:
    rows = kb.select(f"SELECT ?s ?o {{ ?s <urn:t:{predicate}> ?o }} ORDER BY ?s ?o")
    return [f"{row['s'].value[6:]}{getattr(row['o'], 'value', '')[6:]}" for row in rows]


def inferred(kb: rtask.KnowledgeBase) -> set[object]:
    return set(kb.store.quads_for_pattern(None, None, None, kb.graphs.inferred))


@pytest.mark.slow
def test_a_rule_takes_effect_with_its_commit_and_ends_with_its_removal() -> None:
    with rtask.open(":memory:") as kb:
        kb.update(STACK)
        commit = kb.add_rules([ABOVE, CHAIN])
        assert (commit.derived, pairs(kb, "above")) == (3, ["ab", "ac", "bc"])
        kb.remove_rules("above is transitive")
        assert pairs(kb, "above") == ["ab", "bc"]
        kb.update("DELETE DATA { <urn:t:a> <urn:t:on> <urn:t:b> }")
        assert pairs(kb, "above") == ["bc"]


@pytest.mark.slow
def test_a_proof_names_the_rule_and_the_graph_tells_who_added_it_and_when() -> None:
    with rtask.open(":memory:") as kb:
        kb.update(STACK)
        teacher = Access("ada", "teacher", frozenset(("rules",)))
        kb.add_rules(Rule(ABOVE.label, ABOVE.text, "for stacking"), access=teacher)
        proof = kb.explain("urn:t:a", "urn:t:above", NamedNode("urn:t:b"))
        assert proof is not None
        assert proof.rule == "rule:on is above"
        (rule,) = kb.rules()
        assert (rule.label, rule.text, rule.comment) == (ABOVE.label, ABOVE.text, "for stacking")
        assert rule.author == kb.graphs.agent_iri("ada", "teacher")
        assert rule.time is not None
        assert abs((rule.time - kb.catalogue.last_time()).total_seconds()) < 60  # type: ignore[operator]
        row = kb.select(
            f"SELECT ?label {{ GRAPH <{kb.graphs.rules.value}> {{ ?r a <{ontology.NS}Rule> ; "
            "<http://www.w3.org/2000/01/rdf-schema#label> ?label } }"
        )
        assert [r["label"].value for r in row] == ["on is above"]


@pytest.mark.slow
def test_rules_survive_a_restart_and_later_commits_obey_them(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", rules=[ABOVE, CLEAR]) as kb:
        kb.update("INSERT DATA { <urn:t:a> <urn:t:on> <urn:t:b> }")
    with rtask.open(tmp_path / "kb") as kb:
        assert [rule.label for rule in kb.rules()] == [CLEAR.label, ABOVE.label]
        kb.update("INSERT DATA { <urn:t:x> <urn:t:on> <urn:t:a> }")
        assert pairs(kb, "above") == ["ab", "xa"]
        assert pairs(kb, "clear") == ["x"]
        assert kb.verify() == []


@pytest.mark.slow
def test_opening_with_the_same_rules_changes_nothing_and_with_other_text_replaces(
    tmp_path: Path,
) -> None:
    with rtask.open(tmp_path / "kb", rules=ABOVE) as kb:
        kb.update(STACK)
        before = kb.seq
    with rtask.open(tmp_path / "kb", rules=[ABOVE]) as kb:
        assert kb.seq == before
    turned = Rule(ABOVE.label, PREFIX + "CONSTRUCT { ?b :above ?a } WHERE { ?a :on ?b }")
    with rtask.open(tmp_path / "kb", rules=[turned]) as kb:
        assert pairs(kb, "above") == ["ba", "cb"]
        assert len(kb.rules()) == 1


@pytest.mark.slow
def test_rules_added_without_reasoning_are_caught_up_with(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb") as kb:
        kb.update(STACK)
    with rtask.open(tmp_path / "kb", reason=False) as kb:
        kb.add_rules(ABOVE)
        assert pairs(kb, "above") == []
    with rtask.open(tmp_path / "kb") as kb:
        assert pairs(kb, "above") == ["ab", "bc"]


CHANGES = st.lists(
    st.one_of(
        st.sampled_from([ABOVE, CHAIN, CLEAR]),
        st.sampled_from([ABOVE.label, CHAIN.label, CLEAR.label]),
        st.tuples(st.sampled_from("+-"), st.sampled_from("abc"), st.sampled_from("abc")),
    ),
    min_size=1,
    max_size=8,
)


@pytest.mark.slow
@pytest.mark.parametrize("examples", [20, pytest.param(120, marks=pytest.mark.deep)])
def test_any_order_of_rules_and_data_gives_what_a_rebuild_gives(examples: int) -> None:
    kb = rtask.open(":memory:", ontologies=False)

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    @given(CHANGES)
    def check(changes: list[object]) -> None:
        kb.update("DELETE WHERE { ?s <urn:t:on> ?o }")
        kb.remove_rules([rule.label for rule in kb.rules()])
        for change in changes:
            if isinstance(change, Rule):
                kb.add_rules(change)
            elif isinstance(change, str):
                if change in [rule.label for rule in kb.rules()]:
                    kb.remove_rules(change)
            else:
                sign, a, b = change  # type: ignore[misc]
                verb = "INSERT" if sign == "+" else "DELETE"
                kb.update(f"{verb} DATA {{ <urn:t:{a}> <urn:t:on> <urn:t:{b}> }}")
        commit = kb.rebuild("inferred")
        assert (commit.added, commit.removed, commit.derived) == (0, 0, 0)

    with kb:
        check()


@pytest.mark.slow
def test_a_rule_that_leads_to_a_contradiction_is_refused() -> None:
    with rtask.open(":memory:") as kb:
        kb.update(
            "PREFIX owl: <http://www.w3.org/2002/07/owl#> "
            "INSERT DATA { <urn:t:a> <urn:t:on> <urn:t:b> . <urn:t:C> owl:disjointWith <urn:t:D> . "
            "<urn:t:a> a <urn:t:D> }"
        )
        bad = Rule("bad", PREFIX + "CONSTRUCT { ?a a :C } WHERE { ?a :on ?b }")
        with pytest.raises(InconsistentError, match="disjoint"):
            kb.add_rules(bad)
        assert kb.rules() == []


BAD = [
    ("CONSTRCUT { ?a :x ?b } WHERE { ?a :on ?b }", 3, 1, "CONSTRUCT"),
    ("CONSTRUCT { ?a :x ?b } WHERE {\n ?a :on ?b FILTRE(?b > 3) }", 4, 12, "FILTER"),
    ("CONSTRUCT { ?a :x ?b } WHERE { ?a rt:hasGrap ?b }", 3, 35, "hasGrasp"),
    ("CONSTRUCT { ?a :x ?b } WHERE { ?a rtt:hasGrasp ?b }", 3, 35, "rt:"),
    ("CONSTRUCT { ?a :x ?b } WHERE { ?a :on ?b", 3, 30, None),
    ("CONSTRUCT { ?a :x ?b } WHERE { ?a :on ?b OPTIONAL { ?b :on ?c } }", 3, 42, None),
    ("CONSTRUCT { ?a :x ?b }\nWHERE { SERVICE <urn:x> { ?a :on ?b } }", 4, 9, None),
    ("SELECT ?a { ?a :on ?b }", 3, 1, None),
]


@pytest.mark.slow
@pytest.mark.parametrize(("text", "line", "column", "meant"), BAD, ids=range(len(BAD)))
def test_a_bad_text_is_refused_with_its_place_and_nothing_is_stored(
    text: str, line: int, column: int, meant: str | None
) -> None:
    with rtask.open(":memory:") as kb:
        before = kb.seq
        with pytest.raises(ParseError, match=f"rule 'bad' {line}:{column}: ") as caught:
            kb.add_rules([ABOVE, Rule("bad", PREFIX + text)])
        assert (caught.value.details["line"], caught.value.details["column"]) == (line, column)
        assert caught.value.details.get("did_you_mean") == meant
        assert (kb.seq, kb.rules()) == (before, [])


@pytest.mark.slow
def test_negation_in_a_circle_is_refused_when_the_last_rule_closes_it() -> None:
    with rtask.open(":memory:") as kb:
        kb.add_rules(CLEAR)
        circle = PREFIX + "CONSTRUCT { ?a :above ?a } WHERE { ?a :clear true }"
        with pytest.raises(ParseError, match="rule 'circle': negation runs in a circle"):
            kb.add_rules(Rule("circle", circle))
        assert [rule.label for rule in kb.rules()] == [CLEAR.label]


@pytest.mark.slow
def test_adding_rules_is_a_right_of_its_own() -> None:
    with rtask.open(":memory:") as kb:
        graph = kb.graphs.rules
        for access in (
            Access("nao-1", "robot"),
            Access("ada", "teacher"),
            Access(None, "anonymous"),
            Access(None, "reader"),
        ):
            with pytest.raises(ForbiddenError):
                kb.add_rules(ABOVE, access=access)
            with pytest.raises(ForbiddenError):
                kb.update(f"INSERT DATA {{ GRAPH {graph} {{ <urn:r> <urn:p> 1 }} }}", access=access)
        assert kb.rules() == []
        kb.add_rules(ABOVE, access=Access("nao-1", "robot", frozenset(("rules",))))
        with pytest.raises(ForbiddenError, match="right of its own"):
            kb.remove_rules(ABOVE.label, "nao-2")
        with pytest.raises(UsageError, match="unknown right"):
            Access("nao-1", "robot", frozenset(("everything",)))


@pytest.mark.slow
def test_a_rule_written_by_update_is_checked_and_in_force() -> None:
    insert = "PREFIX rt: <{ns}> INSERT DATA {{ GRAPH {graph} {{ <urn:r> rt:ruleText '{text}' }} }}"
    text = "CONSTRUCT {{ ?a <urn:t:above> ?b }} WHERE {{ ?a <urn:t:{p}> ?b {more} }}"
    with rtask.open(":memory:") as kb:
        kb.update(STACK)
        where = {"ns": ontology.NS, "graph": kb.graphs.rules}
        more = "OPTIONAL { ?a ?p ?b }"
        bad = insert.format(text=text.format(p="on", more=more), **where)
        with pytest.raises(ParseError, match="OPTIONAL"):
            kb.update(bad)
        kb.update(insert.format(text=text.format(p="on", more=""), **where))
        assert pairs(kb, "above") == ["ab", "bc"]
        assert [rule.label for rule in kb.rules()] == ["urn:r"]
        kb.update(f"CLEAR GRAPH {kb.graphs.rules}")
        assert pairs(kb, "above") == []


@pytest.mark.slow
def test_another_text_under_a_label_needs_replace() -> None:
    with rtask.open(":memory:") as kb:
        kb.add_rules(ABOVE)
        other = Rule(ABOVE.label, CHAIN.text)
        with pytest.raises(ConflictError, match="replace"):
            kb.add_rules(other)
        kb.add_rules(other, replace=True)
        assert [rule.text for rule in kb.rules()] == [CHAIN.text]
        with pytest.raises(UnknownTermError, match="did you mean 'on is above'"):
            kb.remove_rules("on is abov")


@pytest.mark.slow
def test_a_plain_dataset_and_one_open_for_reading_take_no_rules(tmp_path: Path) -> None:
    with rtask.open(":memory:", plain=True) as kb, pytest.raises(UnsupportedError):
        kb.add_rules(ABOVE)
    rtask.open(tmp_path / "kb").close()
    with pytest.raises(UsageError, match="open for reading"):
        rtask.open(tmp_path / "kb", mode="r", rules=ABOVE)


@pytest.mark.slow
def test_a_file_holds_one_rule_or_several_and_errors_give_its_lines(tmp_path: Path) -> None:
    one, many = tmp_path / "on-above.rq", tmp_path / "stacks.rules"
    one.write_text("# Why.\n" + ABOVE.text)
    many.write_text(
        f"{PREFIX}# rule: on\n# Because.\nCONSTRUCT {{ ?a :above ?b }} WHERE {{ ?a :on ?b }}\n\n"
        "# rule: far\nCONSTRUCT { ?a :above ?c } WHERE { ?a :above ?b . ?b :above ?c }\n"
    )
    with rtask.open(":memory:") as kb:
        kb.update(STACK)
        report = kb.load(one)
        assert (report.files[0].format, report.files[0].derived) == ("rules", 2)
        kb.load(many)
        labels = {rule.label: rule for rule in kb.rules()}
        assert sorted(labels) == ["far", "on", "on-above"]
        assert (labels["on"].comment, labels["on-above"].comment) == ("Because.", "Why.")
        assert labels["far"].text.startswith(PREFIX)
        assert "# rule" not in labels["far"].text
        assert pairs(kb, "above") == ["ab", "ac", "bc"]
        many.write_text(many.read_text().replace("?b :above ?c", "?b :above* ?c"))
        with pytest.raises(ParseError, match=r"rule 'far' 8:"):
            kb.load(many, replace=True)


@pytest.mark.slow
def test_a_backup_has_the_rules_and_an_earlier_state_has_the_earlier_ones(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb") as kb:
        kb.update(STACK)
        before = kb.seq
        kb.add_rules(ABOVE)
        kb.backup(tmp_path / "copy")
        with kb.as_of(before) as past:
            assert past.rules() == []


@pytest.mark.slow
def test_texts_of_rules_need_labels() -> None:
    with pytest.raises(UsageError, match="no label"):
        list(parse_rules(ABOVE.text, ""))
    with rtask.open(":memory:", rules="# rule: on\n" + ABOVE.text) as kb:
        assert [rule.label for rule in kb.rules()] == ["on"]
