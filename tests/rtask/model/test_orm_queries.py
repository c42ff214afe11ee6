"""One question is one SPARQL query, and its answer is right."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rtask.errors import ClosedError, UnknownTermError, UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK, LazyLoadError, Session, avg, count, maximum

pytestmark = pytest.mark.slow

G = RTASK.GraspConfiguration


def _names(kb: KnowledgeBase, iris: list[str]) -> list[str]:
    return [iri.removeprefix(kb.base) for iri in iris]


@pytest.fixture
def queries(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The texts that a knowledge base was asked."""
    asked: list[str] = []
    original = KnowledgeBase.query

    def query(self: KnowledgeBase, text: str, **options: Any) -> Any:
        asked.append(text)
        return original(self, text, **options)

    monkeypatch.setattr(KnowledgeBase, "query", query)
    return asked


def test_a_class_stands_for_its_subclasses(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        assert s.query(RTASK.ManipulableObject).count() == 2
        assert _names(still_lab, s.query(RTASK.Container).ids()) == ["object/1"]
        assert isinstance(s.query(RTASK.Container).one(), RTASK.Mug)


def test_derived_classes_are_found(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        proven = s.query(RTASK.ProvenGrasp).one()
        assert proven.iri == still_lab.base + "grasp/1"
        assert isinstance(proven, RTASK.PlanarGrasp)


def test_without_inference_subclasses_and_inverses_still_work(still_lab: KnowledgeBase) -> None:
    with Session(still_lab, inferred=False) as s:
        assert s.query(RTASK.ProvenGrasp).count() == 0
        mug = s.query(RTASK.ManipulableObject).where(RTASK.Mug.name == "mug").one()
        grasps = s.query(G).where(G.grasp_of == mug).prefetch(G.tried_in, G.grasp_of).all()
        assert [len(grasp.tried_in) for grasp in grasps] == [1, 0]
        assert [list(grasp.grasp_of) for grasp in grasps] == [[mug], [mug]]
        assert len(mug.has_grasp) == 2
        assert len(grasps[0].tried_in) == 1


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        (G.grasp_quality > 0.6, ["1", "3"]),
        (G.grasp_quality >= 0.6, ["1", "2", "3"]),
        (G.grasp_quality == 0.6, ["2"]),
        (G.grasp_quality != 0.6, ["1", "3"]),
        (G.grasp_quality < 0.9, ["2", "3"]),
        (G.grasp_of.mass < 0.2, ["3"]),
        (G.grasp_of.name == "mug", ["1", "2"]),
        (G.grasp_quality.in_([0.6, 0.9]), ["1", "2"]),
        ((G.grasp_quality > 0.85) | (G.grasp_of.name == "pen"), ["1", "3"]),
        ((G.grasp_quality > 0.7) & (G.grasp_of.name == "mug"), ["1"]),
        (~(G.grasp_of.name == "pen"), ["1", "2"]),
        (~((G.grasp_quality > 0.85) | (G.grasp_of.name == "pen")), ["2"]),
        (G.tried_in.is_none(), ["2"]),
        (~G.tried_in.is_none(), ["1", "3"]),
        (G.tried_in.has_outcome.success == True, ["1"]),  # noqa: E712
        (G.tried_in.has_outcome.has_reason == RTASK.reason_missed, ["3"]),
        (G.grasp_of.name.contains("u"), ["1", "2"]),
        (G.grasp_of.name.contains("U", ignore_case=True), ["1", "2"]),
        (G.grasp_of.name.contains("U"), []),
        (G.grasp_of.name.matches("^p.n$"), ["3"]),
    ],
    ids=repr,
)
def test_conditions(still_lab: KnowledgeBase, condition: Any, expected: list[str]) -> None:
    with still_lab.session() as s:
        found = _names(still_lab, s.query(G).where(condition).ids())
        assert found == [f"grasp/{n}" for n in expected]
        assert s.query(G).where(condition).exists() == bool(expected)


def test_order_limit_and_offset(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        best_first = s.query(G).order_by(-G.grasp_quality)
        assert _names(still_lab, [g.iri for g in best_first]) == ["grasp/1", "grasp/3", "grasp/2"]
        assert _names(still_lab, best_first.limit(1).offset(1).ids()) == ["grasp/3"]
        by_object = s.query(G).order_by(G.grasp_of.name, -G.grasp_quality)
        assert _names(still_lab, [g.iri for g in by_object]) == ["grasp/1", "grasp/2", "grasp/3"]
        assert best_first.limit(0).all() == []


def test_an_object_with_several_keys_is_sorted_by_the_best_of_them(
    still_lab: KnowledgeBase,
) -> None:
    """The mug's grasps have 0.9 and 0.6, the pen's 0.8."""
    quality = RTASK.ManipulableObject.has_grasp.grasp_quality
    with still_lab.session() as s:
        things = s.query(RTASK.ManipulableObject)
        for order in (quality, -quality):
            assert _names(still_lab, things.order_by(order).ids()) == ["object/1", "object/2"]
            assert things.order_by(order).limit(1).one().iri == still_lab.base + "object/1"


def test_values_are_rows(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        query = s.query(G).order_by(G.grasp_quality)
        assert list(query.values(G.grasp_of.name, G.tried_in.has_outcome.success)) == [
            ("mug", None),
            ("pen", False),
            ("mug", True),
        ]
        assert list(query.limit(1).values(G.grasp_of)) == [(still_lab.base + "object/1",)]


def test_values_are_read_by_one_query_or_in_batches(
    still_lab: KnowledgeBase, queries: list[str]
) -> None:
    """An object's rows stay together at the edges of batches of every size."""
    T = RTASK.ManipulableObject
    with still_lab.session() as s:
        for query in (s.query(T), s.query(T).where(T.has_grasp.grasp_quality > 0.7)):
            queries.clear()
            rows = query.values(T.name, T.has_grasp.grasp_quality)
            assert len(queries) == 1  # sent before the first row is taken
            every = sorted(rows)
            assert len(queries) == 1
            assert {name for name, _ in every} == {"mug", "pen"}
            assert ("mug", 0.9) in every
            assert ("mug", 0.6) in every
            for batch, sent in ((1, 3), (2, 2), (9, 1)):
                queries.clear()
                rows = query.values(T.name, T.has_grasp.grasp_quality, batch=batch)
                assert next(rows)[0] == "mug"  # the IRI of the mug comes first
                assert len(queries) == 1
                assert len(list(rows)) == len(every) - 1
                assert len(queries) == sent
                again = query.values(T.name, T.has_grasp.grasp_quality, batch=batch)
                assert sorted(again) == every


def test_values_are_refused_before_anything_is_sent(
    still_lab: KnowledgeBase, queries: list[str]
) -> None:
    with still_lab.session() as s:
        query = s.query(G)
        for wrong, words in (
            (lambda: query.values(), "needs the paths"),
            (lambda: query.values(RTASK.Robot.name), "does not begin at"),
            (lambda: query.values(G.grasp_quality, batch=0), "1 or more objects"),
            (lambda: query.limit(1).values(G.grasp_quality, batch=2), "remove order_by"),
        ):
            with pytest.raises(UsageError, match=words):
                wrong()
    assert queries == []


def test_numbers_about_groups(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        rows = (
            s.query(G)
            .group_by(G.grasp_of.name)
            .aggregate(n=count(), best=maximum(G.grasp_quality), tries=count(G.tried_in))
        )
        assert rows == [
            {"name": "mug", "n": 2, "best": 0.9, "tries": 1},
            {"name": "pen", "n": 1, "best": 0.8, "tries": 1},
        ]
        mean = s.query(G).aggregate(mean=avg(G.grasp_quality))["mean"]
        assert mean == pytest.approx((0.9 + 0.6 + 0.8) / 3)


def test_one_first_and_none(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        assert s.query(RTASK.Ball).first() is None
        with pytest.raises(UnknownTermError, match="no Ball matches"):
            s.query(RTASK.Ball).one()
        assert s.query(G).order_by(-G.grasp_quality).limit(1).one().grasp_quality == 0.9
        assert s.query(G).limit(0).first() is None
        with pytest.raises(UsageError, match="several GraspConfiguration match"):
            s.query(G).one()


def test_prefetching_is_one_query_whatever_the_number(
    still_lab: KnowledgeBase, queries: list[str]
) -> None:
    with still_lab.session() as s:
        query = s.query(G).prefetch(G.grasp_of, G.tried_in.has_outcome, G.grasp_pose.in_frame)
        rows = [
            (
                next(iter(grasp.grasp_of)).mass,
                [a.has_outcome.success for a in grasp.tried_in if a.has_outcome],
                grasp.grasp_pose.in_frame.frame_id,  # type: ignore[union-attr]
            )
            for grasp in query
        ]
        assert rows == [(0.3, [True], "table"), (0.3, [], "table"), (0.01, [False], "table")]
        assert queries == [query.sparql()]


def test_as_many_queries_are_asked_about_many_objects_as_about_few(
    kb: KnowledgeBase, queries: list[str]
) -> None:
    asked: dict[int, list[int]] = {}
    for size in (3, 12):
        asked[size] = []
        with Session(kb, agent="nao-1", check_required=False) as s:
            for number in range(size):
                mug = RTASK.Mug(object_id=f"{size}/{number}", name=f"mug {size}", mass=0.3)
                s.add(RTASK.PlanarGrasp(grasp_of=mug, gripper_type="hand", grasp_quality=0.5))
            s.flush()
            asked[size].append(len(queries))
        with kb.session(agent="nao-1") as s:
            mugs = s.query(RTASK.Mug).where(RTASK.Mug.name == f"mug {size}")
            found = mugs.prefetch(RTASK.Mug.has_grasp).all()
            assert len(found) == size
            kinds = [list(grasp.gripper_type) for mug in found for grasp in mug.has_grasp]
            assert kinds == [["hand"]] * size
            asked[size].append(len(queries))
            for mug in found:
                mug.mass = 0.4
            s.flush()
            asked[size].append(len(queries))
            for mug in found:
                s.delete(mug)
            s.flush()
            asked[size].append(len(queries))
            assert mugs.count() == 0
        queries.clear()
    assert asked[3] == asked[12]
    assert max(asked[12]) <= 8


def test_prefetched_objects_outlive_the_next_query(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        grasps = s.query(G).prefetch(G.grasp_of).all()
        s.query(RTASK.Robot).all()
        assert {thing.mass for grasp in grasps for thing in grasp.grasp_of} == {0.3, 0.01}


def test_a_loop_that_would_ask_for_each_object_is_refused(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        grasps = s.query(G).all()
        with pytest.raises(LazyLoadError, match="prefetch"):
            _ = list(grasps[0].tried_in)
        thing = next(iter(grasps[0].grasp_of)) if _loaded(grasps[0]) else None
        assert thing is None


def _loaded(grasp: RTASK.GraspConfiguration) -> bool:
    try:
        return bool(list(grasp.grasp_of))
    except LazyLoadError:
        return False


def test_a_loop_may_ask_where_that_is_wanted(still_lab: KnowledgeBase, queries: list[str]) -> None:
    with Session(still_lab, lazy="allow") as s:
        assert sum(len(grasp.tried_in) for grasp in s.query(G)) == 2
        assert len(queries) == 4
    with Session(still_lab, lazy="warn") as s, pytest.warns(UserWarning, match="prefetch"):
        assert len(next(iter(s.query(G))).tried_in) == 1


def test_one_object_may_be_followed_without_prefetch(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        mug = s.get(RTASK.Mug, still_lab.base + "object/1")
        outcomes = [a.has_outcome for grasp in mug.has_grasp for a in grasp.tried_in]
        assert [outcome.success for outcome in outcomes if outcome] == [True]


def test_streaming_gives_the_same_objects(still_lab: KnowledgeBase, queries: list[str]) -> None:
    with still_lab.session() as s:
        assert [g.iri for g in s.query(G).stream(batch=2)] == s.query(G).ids()
        assert len(queries) == 3
        with pytest.raises(UsageError, match="remove order_by"):
            s.query(G).limit(1).stream()
        with pytest.raises(UsageError, match="1 or more objects, not 0"):
            s.query(G).stream(batch=0)


def test_a_raw_pattern_narrows_too(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        found = s.query(G).raw("?root rt:graspOf/a rt:Pen").where(G.grasp_quality > 0.1)
        assert _names(still_lab, found.ids()) == ["grasp/3"]


def test_conditions_in_one_call_are_about_the_same_value(still_lab: KnowledgeBase) -> None:
    objects = RTASK.ManipulableObject
    with still_lab.session() as s:
        high = objects.has_grasp.grasp_quality > 0.85
        low = objects.has_grasp.grasp_quality < 0.65
        assert s.query(objects).where(high, low).count() == 0
        assert s.query(objects).where(high).where(low).count() == 1


def test_two_graphs_with_one_statement_count_once(lab: KnowledgeBase) -> None:
    mug = f"<{lab.base}object/1>"
    kinds = "rt:Mug, rt:Container"
    lab.update(f"PREFIX rt: <{RTASK._RT}> INSERT DATA {{ {mug} a {kinds} }}", agent="pr2")
    with lab.session() as s:
        assert s.query(RTASK.Container).count() == 1
        assert len(s.query(RTASK.Container).all()) == 1


def test_a_path_must_begin_at_the_class(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        with pytest.raises(UsageError, match="does not begin at GraspConfiguration"):
            s.query(G).where(RTASK.Frame.frame_id == "table")
        with pytest.raises(UsageError, match="plain values"):
            s.query(G).prefetch(G.grasp_quality)
        with pytest.raises(UsageError, match="is_none"):
            s.query(G).where(G.grasp_quality == None).all()  # noqa: E711
        with pytest.raises(UsageError, match="no truth value"):
            s.query(G).where(0.1 < G.grasp_quality < 0.9)


def test_text_in_the_place_of_a_path_is_refused(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        query: Any = s.query(G)
        for wrong in (query.order_by, query.prefetch, query.group_by, query.min, query.values):
            with pytest.raises(UsageError, match=r"a path such as .*, not 'grasp_quality'"):
                wrong("grasp_quality")
        with pytest.raises(UsageError, match="not an aggregate: 3"):
            query.aggregate(number=3)


def test_after_closing_nothing_is_asked(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        query = s.query(G)
    with pytest.raises(ClosedError):
        query.all()


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(text=st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=40))
def test_hostile_text_stays_text(still_lab: KnowledgeBase, text: str) -> None:
    """Whatever the text, the query parses and finds no more than what equals it."""
    with still_lab.session() as s:
        name = RTASK.ManipulableObject.name
        for condition in (name == text, name.contains(text), name.in_([text])):
            found = s.query(RTASK.ManipulableObject).where(condition).all()
            assert all(text in "".join(thing.name) for thing in found)


def test_a_field_of_an_object_that_was_not_read_names_the_path_to_prefetch(
    still_lab: KnowledgeBase,
) -> None:
    grasps = RTASK.GraspConfiguration
    with still_lab.session() as s:
        first = s.query(grasps).all()[0]
        with pytest.raises(AttributeError) as unread:
            first.grasp_pose.x  # type: ignore[union-attr]  # noqa: B018
        assert "FramedMeasure has no field 'x', but " in str(unread.value)
        assert "add .prefetch(GraspConfiguration.grasp_pose) to it" in str(unread.value)
        assert not hasattr(first.grasp_pose, "x")
        with pytest.raises(AttributeError, match="has no field 'qualty'; did you mean"):
            first.qualty  # type: ignore[attr-defined]  # noqa: B018
        with pytest.raises(LazyLoadError, match=r"add \.prefetch\(GraspConfiguration\.tried_in\)"):
            len(first.tried_in)
    with still_lab.session() as s:
        read = s.query(grasps).prefetch(grasps.grasp_pose).all()[0]
        assert isinstance(read.grasp_pose.x, float)  # type: ignore[union-attr]
    with pytest.raises(AttributeError, match=r"add \.prefetch\(GraspConfiguration\.grasp_pose\)"):
        grasps.grasp_pose.x  # type: ignore[attr-defined]  # noqa: B018
