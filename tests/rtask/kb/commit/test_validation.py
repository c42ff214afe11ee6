"""SHACL on write: what a change touches is held against the shapes, nothing else is."""

from __future__ import annotations

import pytest

import rtask
from rtask.errors import UsageError, ValidationError
from rtask.kb.commit import validation
from rtask.knowledge_base import KnowledgeBase

pytestmark = pytest.mark.slow

_RT = "https://w3id.org/rtask-kg/ns#"
_MUG = '<urn:mug> a rt:Mug ; rt:objectId "lab/mug" ; rt:mass 0.31e0'


def _update(kb: KnowledgeBase, text: str, agent: str = "nao-1") -> rtask.kb.commit.commit.Commit:
    return kb.update(f"PREFIX rt: <{_RT}> {text}", agent)


@pytest.fixture(scope="module")
def strict() -> KnowledgeBase:
    return rtask.open(":memory:", validate=True)


def _results(error: pytest.ExceptionInfo[ValidationError]) -> list[tuple[str, str | None]]:
    return [
        (r["focus"], (r["path"] or "").rpartition("#")[2][:-1])
        for r in error.value.details["results"]
    ]


def test_what_has_its_shape_is_stored(strict: KnowledgeBase) -> None:
    commit = _update(strict, f"INSERT DATA {{ {_MUG} }}")
    assert commit.warnings == ()
    assert commit.derived > 0


def test_a_violation_refuses_the_commit_and_says_what_and_where(strict: KnowledgeBase) -> None:
    before = strict.seq
    with pytest.raises(ValidationError, match="nothing was stored") as error:
        _update(strict, "INSERT DATA { <urn:cup> a rt:Mug ; rt:mass -1e0 }")
    assert sorted(_results(error)) == [("<urn:cup>", ""), ("<urn:cup>", "mass")]
    messages = [result["message"] for result in error.value.details["results"]]
    assert any("an object needs an rt:objectId" in message for message in messages)
    assert error.value.details["results"][0].keys() >= {
        "focus",
        "path",
        "value",
        "message",
        "shape",
    }
    assert strict.seq == before
    assert strict.match("urn:cup") == []
    assert _update(strict, 'INSERT DATA { <urn:cup> a rt:Mug ; rt:objectId "lab/cup" }').added == 2


def test_taking_away_what_a_shape_needs_is_refused(strict: KnowledgeBase) -> None:
    _update(strict, 'INSERT DATA { <urn:jug> a rt:Mug ; rt:objectId "lab/jug" }')
    with pytest.raises(ValidationError) as error:
        _update(strict, 'DELETE DATA { <urn:jug> rt:objectId "lab/jug" }')
    assert _results(error) == [("<urn:jug>", "")]
    assert "an object needs an rt:objectId" in str(error.value)
    _update(strict, "DELETE WHERE { <urn:jug> ?p ?o }")


def test_one_robot_states_one_value_and_two_may_differ(strict: KnowledgeBase) -> None:
    _update(strict, 'INSERT DATA { <urn:can> a rt:Can ; rt:objectId "lab/can" ; rt:mass 0.3e0 }')
    _update(strict, "INSERT DATA { <urn:can> rt:mass 0.2e0 }", "nao-2")
    with pytest.raises(ValidationError) as error:
        _update(strict, "INSERT DATA { <urn:can> rt:mass 0.4e0 }")
    [result] = error.value.details["results"]
    assert result["graph"] == strict.graphs.agent("nao-1").value


def test_a_change_reaches_the_node_that_points_at_it() -> None:
    """rt:hasWaypoint/rt:timeFromStart must not be negative, wherever the change begins."""
    with rtask.open(":memory:", validate="warn") as kb:
        _update(
            kb,
            "INSERT DATA { <urn:grasp> rt:graspPosture <urn:posture> . "
            "<urn:posture> rt:hasWaypoint <urn:way> . <urn:way> rt:waypointIndex 0 }",
        )
        commit = _update(kb, "INSERT DATA { <urn:way> rt:timeFromStart -0.5e0 }")
        assert "<urn:posture>" in {one.focus for one in commit.warnings if one.value}


@pytest.mark.slow
def test_warnings_come_with_the_commit_and_the_whole_is_validated_on_demand() -> None:
    with rtask.open(":memory:", validate="warn") as kb:
        commit = _update(kb, "INSERT DATA { <urn:cup> a rt:Mug }")
        [warning] = commit.warnings
        assert warning.focus == "<urn:cup>"
        assert warning.severity == "Violation"
        assert [one.focus for one in kb.validate()] == ["<urn:cup>"]
        _update(kb, 'INSERT DATA { <urn:cup> rt:objectId "lab/cup" }')
        assert kb.validate() == []


def test_what_no_shape_concerns_starts_no_validator(monkeypatch: pytest.MonkeyPatch) -> None:
    with rtask.open(":memory:", ontologies=False, reason=False, validate=True) as kb:
        monkeypatch.setattr(validation, "run", lambda *_: pytest.fail("was asked"))
        _update(kb, "INSERT DATA { <urn:a> <urn:p> 1 }")


def test_unknown_policies_are_refused() -> None:
    with pytest.raises(UsageError, match="one of False, True, off, warn, refuse"):
        rtask.open(":memory:", validate="maybe")


def test_negative_numbers_are_written(strict: KnowledgeBase) -> None:
    """A sign and its number are two tokens of SPARQL and one of TriG."""
    strict.update(
        "INSERT DATA { <urn:n> <urn:p> -1, -2.5, -3e0 . GRAPH <urn:g> { <urn:n> <urn:p> -4 } }"
    )
    values = sorted(str(quad.object.value) for quad in strict.match("urn:n"))  # type: ignore[union-attr]
    assert values == ["-1", "-2.5", "-3", "-4"]
