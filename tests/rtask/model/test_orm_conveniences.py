"""Conveniences of object layers: slices, bulk changes, commit and rollback, dictionaries."""

from __future__ import annotations

import copy
import gc
import json
import pickle
import warnings
from typing import Any

import pytest

from rtask.errors import UsageError
from rtask.knowledge_base import KnowledgeBase
from rtask.model import RTASK, FieldError, OwnershipError, Session, avg, count, maximum

pytestmark = pytest.mark.slow

G = RTASK.GraspConfiguration
THING = RTASK.ManipulableObject


# Queries


def test_a_slice_reads_no_more_than_it_shows(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        query = s.query(G).order_by(-G.grasp_quality)
        assert [g.grasp_quality for g in query[1:]] == [0.8, 0.6]
        assert [g.grasp_quality for g in query[:2]] == [0.9, 0.8]
        assert [g.grasp_quality for g in query[1:2]] == [0.8]
        assert query[2:1] == []
        assert query[2].grasp_quality == 0.6
        assert query.offset(1)[1].grasp_quality == 0.6
        assert query.limit(2)[1:9] == query[1:2]
        with pytest.raises(IndexError, match="position 1"):
            query.limit(1)[1]
        with pytest.raises(UsageError, match="0 or more"):
            query[-1]
        with pytest.raises(UsageError, match="no step"):
            query[::2]


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        (THING.mass.between(0.01, 0.3), ["1", "2"]),
        (THING.mass.between(0.02, 0.3), ["1"]),
        (~THING.mass.between(0.02, 0.3), ["2"]),
        (THING.has_grasp.grasp_quality.between(0.65, 0.85), ["2"]),
        (THING.name.startswith("m"), ["1"]),
        (THING.name.startswith("M"), []),
        (THING.name.startswith("M", ignore_case=True), ["1"]),
        (THING.name.endswith("n"), ["2"]),
        (THING.name.startswith("u"), []),
    ],
)
def test_ranges_and_ends_of_text(
    still_lab: KnowledgeBase, condition: Any, expected: list[str]
) -> None:
    """The mug's grasps have 0.9 and 0.6: neither lies in the range, though one is on each side."""
    with still_lab.session() as s:
        found = [name.rsplit("/", 1)[1] for name in s.query(THING).where(condition).ids()]
    assert found == expected


def test_groups_are_kept_by_their_numbers(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        groups = s.query(G).group_by(G.grasp_of.name)
        assert groups.having(count() > 1).aggregate(n=count()) == [{"name": "mug", "n": 2}]
        assert groups.having(count() == 1).aggregate(n=count()) == [{"name": "pen", "n": 1}]
        best = groups.having(maximum(G.grasp_quality) >= 0.9, count() < 9)
        assert best.aggregate(mean=avg(G.grasp_quality)) == [{"name": "mug", "mean": 0.75}]
        assert groups.having(avg(G.grasp_quality) != 0.8).aggregate() == [{"name": "mug"}]
        named = groups.having(maximum(G.grasp_of.name) <= "n").aggregate(n=count())
        assert [row["name"] for row in named] == ["mug"]
        with pytest.raises(UsageError, match="compared with a number"):
            groups.having(count() > "1").aggregate(n=count())
        with pytest.raises(UsageError, match="not a condition on a group"):
            groups.having(G.grasp_quality > 0.1)  # type: ignore[arg-type]


def test_single_numbers(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        query = s.query(G)
        assert (query.min(G.grasp_quality), query.max(G.grasp_quality)) == (0.6, 0.9)
        assert query.sum(G.grasp_quality) == pytest.approx(2.3)  # a sum of doubles
        assert query.where(G.grasp_quality > 2.0).max(G.grasp_quality) is None
        assert query.where(G.grasp_quality > 2.0).sum(G.grasp_quality) == 0
        with pytest.raises(UsageError, match="remove limit"):
            query.limit(1).max(G.grasp_quality)


# Changing many


def test_an_update_of_many_is_one_commit(lab: KnowledgeBase) -> None:
    before = lab.seq
    with lab.session("nao-1") as s:
        found = s.query(G).where(G.grasp_of.name == "mug")
        assert found.update(grasp_quality=0.5, gripper_type="other") == 2
        assert s.query(G).where(G.grasp_quality == 0.5).count() == 0
    assert lab.seq == before + 1
    with lab.session() as s:
        values = s.query(G).order_by(G.grasp_quality)
        assert list(values.values(G.grasp_quality, G.gripper_type)) == [
            (0.5, "other"),
            (0.5, "other"),
            (0.8, "nao_hand"),
        ]


def test_an_update_checks_values_and_unsets(lab: KnowledgeBase) -> None:
    with lab.session("nao-1") as s:
        with pytest.raises(FieldError, match="no field 'masss'"):
            s.query(THING).update(masss=1.0)
        with pytest.raises(FieldError, match="takes a number"):
            s.query(THING).update(mass="heavy")
        s.rollback()
        assert s.query(THING).update(mass=None) == 2
    with lab.session() as s:
        assert s.query(THING).where(THING.mass.is_none()).count() == 2


def test_an_update_of_links_keeps_both_sides_in_step(lab: KnowledgeBase) -> None:
    with lab.session("nao-1") as s:
        pen = s.query(RTASK.Pen).one()
        assert s.query(G).update(grasp_of=pen) == 3
    with lab.session() as s:
        assert len(s.query(RTASK.Pen).one().has_grasp) == 3
        assert len(s.query(RTASK.Mug).one().has_grasp) == 0


def test_many_are_deleted_with_the_limit_of_the_query(lab: KnowledgeBase) -> None:
    with lab.session("nao-1") as s:
        query = s.query(G).order_by(G.grasp_quality)
        assert query.limit(2).delete() == 2
        assert query.limit(2).delete() == 0  # they are to be deleted already
    with lab.session() as s:
        assert s.query(G).one().grasp_quality == 0.9


def test_deleting_a_field_takes_back_own_values(lab: KnowledgeBase) -> None:
    with lab.session("nao-1") as s:
        mug = s.query(RTASK.Mug).one()
        del mug.mass
        del mug.name
        assert (mug.mass, list(mug.name)) == (None, [])
    with lab.session("pr2") as s:
        mug = s.query(RTASK.Mug).one()
        assert (mug.mass, list(mug.name)) == (None, [])
        del mug.object_id
        with pytest.raises(OwnershipError):
            s.commit()
        s.rollback()
        assert mug.object_id == "lab/mug-1"


# Sessions


def test_rollback_discards_changes_and_the_session_goes_on(lab: KnowledgeBase) -> None:
    before = lab.seq
    with lab.session("nao-1") as s:
        mug, pen = s.query(RTASK.Mug).one(), s.query(RTASK.Pen).one()
        grasp = s.get(RTASK.PlanarGrasp, lab.base + "grasp/1")
        cup = RTASK.Mug(iri=lab.base + "object/9", object_id="lab/mug-9")
        s.add(cup)
        mug.mass = 0.5
        grasp.grasp_of = [pen]
        s.annotate(mug, "mass", confidence=0.5)
        s.delete(pen)
        s.rollback()
        assert (s.new, s.dirty, s.deleted) == ([], [], [])
        assert (mug.mass, list(grasp.grasp_of)) == (0.3, [mug])
        assert (len(mug.has_grasp), len(pen.has_grasp)) == (2, 1)
        assert s.commit() is None
        assert lab.seq == before
        assert cup.object_id == "lab/mug-9"
        s.add(cup)
        mug.mass = 0.4
        assert s.commit() is not None
    with lab.session() as s:
        masses = s.query(RTASK.Mug).order_by(RTASK.Mug.mass).values(RTASK.Mug.mass)
        assert list(masses) == [(None,), (0.4,)]


def test_queries_see_changes_where_they_are_flushed_first(lab: KnowledgeBase) -> None:
    heavy = THING.mass > 0.45
    with lab.session("nao-1") as s:
        s.query(RTASK.Mug).one().mass = 0.5
        assert s.query(THING).where(heavy).count() == 0
        s.rollback()
    with lab.session("nao-1", autoflush=True) as s:
        mug = s.query(RTASK.Mug).one()
        mug.mass = 0.5
        with s.no_autoflush():
            assert not s.query(THING).where(heavy).exists()
        assert s.query(THING).where(heavy).exists()
        before = lab.seq
        assert s.query(THING).where(heavy).all() == [mug]
        assert lab.seq == before  # nothing changed since


def test_a_session_dropped_with_changes_warns(lab: KnowledgeBase) -> None:
    def drop(change: bool, close: bool) -> None:
        session = Session(lab, "nao-1")
        mug = session.query(RTASK.Mug).one()
        if change:
            mug.mass = 0.5
        if close:
            session.close()
        del mug, session
        gc.collect()

    with pytest.warns(ResourceWarning, match="nao-1 was dropped with changes"):
        drop(change=True, close=False)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        drop(change=False, close=False)
        drop(change=True, close=True)
    assert [w for w in caught if "was dropped" in str(w.message)] == []


# Dictionaries


def test_an_object_as_a_dictionary_and_as_json(lab: KnowledgeBase) -> None:
    with lab.session("nao-1") as s:
        mug = s.query(RTASK.Mug).one()
        found = mug.to_dict()
        stated = {
            "iri": lab.base + "object/1",
            "class": "Mug",
            "object_id": "lab/mug-1",
            "name": ["mug"],
            "mass": 0.3,
            "grasp_width": 0.07,
        }
        assert {name: found[name] for name in stated} == stated
        assert found["effective_mass"] == 0.3  # derived
        assert json.loads(mug.to_json(indent=2)) == found
        mug.mass = 0.4
        assert mug.to_dict()["mass"] == 0.4
        s.rollback()
        grasps = s.query(G).prefetch(G.grasp_of).order_by(-G.grasp_quality).all()
        first = grasps[0].to_dict()  # one of many: nothing is read for it alone
        assert first["grasp_of"] == [lab.base + "object/1"]
        assert "tried_in" not in first


def test_a_new_object_as_a_dictionary() -> None:
    mug = RTASK.Mug(object_id="lab/mug-1", name=["b", "a"])
    assert mug.to_dict() == {
        "iri": None,
        "class": "Mug",
        "object_id": "lab/mug-1",
        "name": ["a", "b"],
    }


# What other object layers have


@pytest.mark.parametrize("mass", [float("nan"), float("inf"), float("-inf")])
def test_numbers_that_nobody_measured_are_refused(mass: float) -> None:
    with pytest.raises(FieldError, match="takes a finite number"):
        RTASK.Mug(mass=mass)


def test_two_objects_with_one_object_id_are_refused(lab: KnowledgeBase) -> None:
    with lab.session(agent="nao-1") as s:
        s.add(RTASK.Mug(iri="urn:first", object_id="lab/once"))
    for agent in ("nao-1", "nao-2"):
        s = lab.session(agent=agent)
        s.add(RTASK.Mug(object_id="lab/once"))
        with pytest.raises(FieldError, match="is that of urn:first already"):
            s.flush()
        s.close()
    s = lab.session(agent="nao-1")
    for name in ("urn:a", "urn:b"):
        s.add(RTASK.Mug(iri=name, object_id="lab/twice"))
    with pytest.raises(FieldError, match="object_id of <Mug urn:b>"):
        s.flush()
    s.close()
    with lab.session(agent="nao-2") as s:
        s.get(RTASK.Mug, "urn:first").object_id = "lab/once"


@pytest.mark.parametrize(
    ("name", "instead"),
    [("filter", "where"), ("filter_by", "where"), ("one_or_none", "first"), ("scalars", "all")],
)
def test_names_of_another_object_layer_say_what_to_use(
    still_lab: KnowledgeBase, name: str, instead: str
) -> None:
    with still_lab.session() as s:
        with pytest.raises(AttributeError, match=f"no '{name}'; use {instead}"):
            getattr(s.query(THING), name)
        for missing, use in (("add_all", "add"), ("merge", "get"), ("scalars", "query")):
            with pytest.raises(AttributeError, match=f"no '{missing}'; use {use}"):
                getattr(s, missing)
        with pytest.raises(AttributeError, match=r"no like\(\) on a field; use contains"):
            THING.name.like("m%")


def test_an_open_graph_and_its_sessions_say_why_they_are_not_pickled(
    still_lab: KnowledgeBase,
) -> None:
    with still_lab.session() as session:
        for whole in (still_lab, session, session.query(RTASK.Mug)):
            with pytest.raises(UsageError, match=r"open .* in the other process"):
                pickle.dumps(whole)


def test_an_object_says_why_it_is_not_pickled(still_lab: KnowledgeBase) -> None:
    with still_lab.session() as s:
        mug = s.query(RTASK.Mug).one()
        for duplicate in (pickle.dumps, copy.copy):
            with pytest.raises(UsageError, match="neither pickled nor copied; pass on its iri"):
                duplicate(mug)
        assert pickle.loads(pickle.dumps(mug.to_dict()))["iri"] == mug.iri
