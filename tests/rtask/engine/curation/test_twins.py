"""Robots that insert one product at once make one object of it."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from rtask.engine.operations import insert
from rtask.rdf.namespaces import RT


@pytest.fixture
def gathered(engine, monkeypatch):
    """Return a semaphore that is released when a request has been recognised, before it writes."""
    ready, prepare = threading.Semaphore(0), insert.prepare

    def prepared(*args):
        found = prepare(*args)
        ready.release()
        return found

    monkeypatch.setattr(insert, "prepare", prepared)
    return ready


def insert_at_once(engine, gathered, jobs):
    """Run jobs in threads, all of which recognise before any of them writes."""
    with ThreadPoolExecutor(len(jobs)) as pool:
        with engine.context.writing:
            running = [pool.submit(job) for job in jobs]
            for _ in jobs:
                assert gathered.acquire(timeout=60)
        return [one.result()["objects"][0] for one in running]


def objects(kb):
    return {quad.subject for quad in kb.match(None, RT.objectId)}


def views(bench, thing, count):
    """Return what each robot sends of a thing: the same side, each with its own noise."""
    target = (*thing.position, bench.TABLE)
    return [bench.sight(thing, bench.Eye(target=target, noise_seed=k)) for k in range(count)]


@pytest.mark.slow
@pytest.mark.parametrize(("count", "others"), [(4, 2), pytest.param(20, 0, marks=pytest.mark.deep)])
def test_simultaneous_insertions_of_one_product_make_no_twin(
    bench, kb, engine, robots, gathered, count, others
):
    robot = robots()
    for known in (bench.CAN, bench.PEN)[:others]:
        robot.insert(bench.sight(known))
        gathered.acquire()
    jobs = [lambda seen=seen: robot.insert(seen) for seen in views(bench, bench.BOX, count)]
    answers = insert_at_once(engine, gathered, jobs)
    assert len(objects(kb)) == others + 1
    assert len({answer["object"] for answer in answers}) == 1
    assert sorted(answer["new"] for answer in answers) == [False] * (count - 1) + [True]
    assert len({answer["view"] for answer in answers}) == count
    assert robot.recognise(bench.sight(bench.BOX))["object"] == answers[0]["object"]


def test_what_is_inserted_alone_is_looked_at_once_be_it_the_first_of_all(bench, robots, gathered):
    robot = robots()
    robot.insert(bench.sight(bench.BOX))
    assert gathered.acquire(blocking=False)
    assert not gathered.acquire(blocking=False)


@pytest.mark.slow
def test_different_products_inserted_at_once_stay_apart(bench, kb, engine, robots, gathered):
    robot = robots()
    seen = [bench.sight(thing) for thing in (bench.BOX, bench.CAN, bench.PEN)]
    jobs = [lambda one=one: robot.insert(one) for one in seen]
    answers = insert_at_once(engine, gathered, jobs)
    assert len({answer["object"] for answer in answers}) == len(objects(kb)) == 3


@pytest.mark.slow
def test_an_insertion_that_asks_for_a_new_object_gets_one(bench, kb, engine, robots, gathered):
    robot = robots()
    seen = views(bench, bench.CAN, 2)
    jobs = [lambda one=one: robot.insert(one, merge=False) for one in seen]
    answers = insert_at_once(engine, gathered, jobs)
    assert all(answer["new"] for answer in answers)
    assert len(objects(kb)) == 2


@pytest.mark.slow
def test_an_object_with_the_print_of_another_is_told_so_and_sight_decides_for_neither(
    bench, kb, engine, robots
):
    robot = robots()
    seen = views(bench, bench.BOX, 3)
    (first,) = robot.insert(seen[0], name="tea")["objects"]
    assert "same_print" not in first
    (other,) = robot.insert(bench.sight(bench.CAN))["objects"]
    assert "same_print" not in other
    (second,) = robot.insert(seen[1], name="tea, other shop", merge=False)["objects"]
    assert second["new"]
    assert second["same_print"] == [first["object"]]
    assert second["message"].startswith("the same print as tea:")
    answer = robot.recognise(seen[2])
    assert answer["object"] == ""
    assert answer["recognition"]["outcome"] == "multiple"
    alike = {one["object"] for one in answer["similar_objects"][:2]}
    assert alike == {first["object"], second["object"]}


@pytest.mark.slow
def test_another_view_of_the_same_object_is_no_twin(bench, kb, engine, robots):
    robot = robots()
    seen = views(bench, bench.BOX, 2)
    (first,) = robot.insert(seen[0])["objects"]
    (again,) = robot.insert(seen[1], object=first["object"])["objects"]
    assert "same_print" not in again
