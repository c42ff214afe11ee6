"""What a robot reaches, as robots and people state it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from rtask.engine import Engine
from rtask.errors import ForbiddenError, UnknownTermError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import PREFIXES, RT
from tests.rtask.world.conftest import BASE, Lab

NAO, OTHER, ANN = Access("nao-1", "robot"), Access("nao-2", "robot"), Access("ann", "teacher")
ROBOT = f"{BASE}robot/nao-1"
State = Callable[..., dict[str, Any]]


@pytest.fixture
def engine(lab: Lab) -> Iterator[Engine]:
    with Engine(lab.kb) as made:
        yield made


@pytest.fixture
def state(engine: Engine) -> State:
    def state(access: Access, **args: Any) -> dict[str, Any]:
        return engine.call("state_reach", args, access).as_json()

    return state


def reached(lab: Lab) -> set[tuple[str, str, str]]:
    """Return what robots reach, with the graph that says so."""
    return {
        (quad.subject.value, quad.object.value, quad.graph_name.value)
        for quad in lab.kb.match(None, RT.reaches)
    }


def test_a_robot_states_it_of_its_own_places_by_their_names_and_takes_it_back(
    lab: Lab, state: State
) -> None:
    said = state(NAO, place="left box")
    assert (said["robot"], said["place"]) == (ROBOT, lab.left_box)
    home = lab.kb.graphs.agent("nao-1").value
    assert reached(lab) == {(ROBOT, lab.left_box, home)}
    assert said["commit"]
    assert not state(NAO, place=lab.left_box)["commit"], "it is stated once"
    assert state(NAO, place="left box", withdrawn=True)["commit"]
    assert not reached(lab)


def test_a_person_states_it_of_a_robot_in_a_graph_of_her_own(lab: Lab, state: State) -> None:
    state(ANN, robot="nao-2", place="left box")
    ((robot, place, graph),) = reached(lab)
    assert (robot, place) == (f"{BASE}robot/nao-2", lab.left_box), "the only place of that name"
    assert graph == lab.kb.graphs.agent("ann").value
    with pytest.raises(UsageError, match="has not stated"):
        state(OTHER, place="left box", withdrawn=True)
    assert state(ANN, robot="nao-2", place="left box", withdrawn=True)["commit"]


def test_nobody_states_it_for_another(lab: Lab, state: State) -> None:
    for args in ({"robot": "nao-1"}, {"robot": ROBOT}, {"agent": "nao-1"}):
        with pytest.raises(ForbiddenError, match="the token belongs to 'nao-2'"):
            state(OTHER, place=lab.left_box, **args)
    with pytest.raises(ForbiddenError, match="the token belongs to 'ann'"):
        state(ANN, robot="nao-1", place=lab.left_box, agent="ben")
    assert not reached(lab)


def test_the_own_place_comes_before_that_of_another_and_two_of_others_are_asked_about(
    lab: Lab, state: State
) -> None:
    def box(robot: str) -> str:
        iri = f"{BASE}robot/{robot}/place/left%20box"
        text = f'<{iri}> a rt:SupportSurface ; rt:name "left box"'
        lab.kb.update(f"{PREFIXES} INSERT DATA {{ {text} }}", agent=robot)
        return iri

    own = box("nao-2")
    assert state(OTHER, place="left box")["place"] == own
    register = f'{PREFIXES} INSERT DATA {{ <{BASE}robot/late> a cora:Robot ; rt:name "late" }}'
    lab.kb.update(register, agent="late")
    with pytest.raises(UsageError, match="2 places are called 'left box'; give the IRI"):
        state(Access("late", "robot"), place="left box")


@pytest.mark.parametrize(
    ("error", "access", "args", "message"),
    [
        (UsageError, ANN, {"place": "left box"}, "robot is missing"),
        (UnknownTermError, ANN, {"place": "left box", "robot": "nao-9"}, "no robot 'nao-9'"),
        (UnknownTermError, NAO, {"place": "left bo"}, "did you mean 'left box'"),
        (UnknownTermError, NAO, {"place": "urn:x"}, "no table or box urn:x"),
        (UnknownTermError, NAO, {"place": f"{BASE}robot/nao-2"}, "no table or box http"),
        (UsageError, NAO, {"place": "left box", "withdrawn": True}, "has not stated"),
    ],
)
def test_what_is_wrong_is_named(
    state: State, error: type[Exception], access: Access, args: dict[str, Any], message: str
) -> None:
    with pytest.raises(error, match=message):
        state(access, **args)
