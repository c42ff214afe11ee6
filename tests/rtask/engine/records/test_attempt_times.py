"""Times of attempts: one clock for all that a graph tells, whatever clock a simulation has."""

from __future__ import annotations

import datetime as dt

import pytest

import ontology
from rtask.errors import UsageError
from rtask.rdf.namespaces import PREFIXES, RT

pytestmark = pytest.mark.slow

START = dt.datetime(2026, 5, 4, 10, 0, 0, tzinfo=dt.UTC)


def at(seconds):
    """Return a time, s since the epoch."""
    return START.timestamp() + seconds


@pytest.fixture
def tried(bench, robots):
    """Return a function that reports an attempt at the box."""
    seen = bench.sight(bench.BOX)

    def report(outcome, name="nao-1", **look):
        robot = robots(name)
        answer = robot.recognise({**seen, **look})
        return robot.insert(
            {**seen, **look}, grasp=answer["grasps"][0], outcome=outcome, task_id=answer["task_id"]
        )["objects"][0]["object"]

    return report


def times(kb):
    """Return start and end, s after ``START``, and seconds of execution of all attempts."""
    rows = kb.select(f"""{PREFIXES}
SELECT ?started ?ended ?seconds WHERE {{ ?attempt a rt:GraspAttempt ; prov:endedAtTime ?ended
  OPTIONAL {{ ?attempt prov:startedAtTime ?started }}
  OPTIONAL {{ ?attempt rt:executionTime ?seconds }} }} ORDER BY ?ended""").to_dicts()

    def after(value):
        if value is None:
            return None
        return (dt.datetime.fromisoformat(str(value)) - START).total_seconds()

    return [(after(row["started"]), after(row["ended"]), row["seconds"]) for row in rows]


def test_attempts_of_a_simulation_that_outruns_the_clock_do_not_overlap(bench, tried, kb):
    tried(bench.missed(duration_s=30.0, started=at(1), ended=at(4)))
    tried(bench.held(duration_s=40.0, started=at(5), ended=at(9), attempt_number=2))
    assert times(kb) == [(1.0, 4.0, 30.0), (5.0, 9.0, 40.0)]


def test_simulated_seconds_alone_do_not_tell_when_an_attempt_started(bench, tried, kb):
    tried(bench.held(duration_s=40.0, ended=at(9)))
    assert times(kb) == [(None, 9.0, 40.0)]


def test_a_real_robots_attempt_started_its_duration_before_its_end(bench, tried, kb):
    tried(bench.held(preset="real", duration_s=6.5, ended=at(9)))
    assert times(kb) == [(2.5, 9.0, 6.5)]


def test_an_attempt_that_ended_before_it_started_is_refused_and_nothing_stored(bench, tried, kb):
    with pytest.raises(UsageError, match=r"outcome.started: 2026-05-04T10:00:10.* by one clock"):
        tried(bench.held(started=at(10), ended=at(9)))
    with pytest.raises(UsageError, match=r"outcome.duration_s: 1e\+12 s are longer"):
        tried(bench.held(preset="real", duration_s=1e12, ended=at(9)))
    assert times(kb) == kb.match(None, RT.objectId) == []


def test_what_was_seen_before_an_attempt_holds_until_the_attempt_ended(bench, tried, kb):
    tried(bench.missed(started=at(2), ended=at(5)), frame_id="base_link", stamp=at(1))
    (row,) = kb.select(f"""{PREFIXES}
SELECT ?seen ?over WHERE {{ ?estimate rt:estimatedPose/rt:atTime ?seen ;
  prov:invalidatedAtTime ?over }}""").to_dicts()
    assert [dt.datetime.fromisoformat(str(row[name])).timestamp() for name in row] == [at(1), at(5)]


def test_tasks_of_two_robots_that_worked_at_the_same_time_overlap(bench, tried, kb):
    tried(bench.missed(started=at(1), ended=at(4)))
    tried(bench.held(started=at(5), ended=at(9), attempt_number=2))
    tried(bench.held(started=at(8), ended=at(12)), name="nao-2")
    (query,) = [path for path in ontology.queries() if path.stem == "cq09"]
    (row,) = kb.select(query.read_text("utf-8")).to_dicts()
    who = kb.select(f"""{PREFIXES}
SELECT ?robot ?number WHERE {{ VALUES ?task {{ <{row["a"]}> <{row["b"]}> }}
  ?task rt:through ?attempt . ?attempt rt:performedBy/rt:name ?robot ; rt:attemptNumber ?number }}
ORDER BY ?robot""").to_dicts()
    assert [(one["robot"], int(one["number"])) for one in who] == [("nao-1", 2), ("nao-2", 1)]
