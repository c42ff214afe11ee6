"""One robot of a crew by itself, while the others work on other machines."""

from __future__ import annotations

from collections.abc import Callable

from simulate.tasks.executor import Executor, Graph, Turn

__all__ = ["await_plan", "work_alone"]


def await_plan(graph: Graph, wait: Callable[[int], bool]) -> bool:
    """Wait until there is an open plan; return whether one came.

    Parameters
    ----------
    graph
        A client in the name of the robot.
    wait
        Called with the number of looks so far; returns whether to look again.
    """
    looks = 0
    while not graph.call("list_plans", state="open")["plans"]:
        looks += 1
        if not wait(looks):
            return False
    return True


def work_alone(
    graph: Graph,
    executor: Executor,
    before: Callable[[], None],
    tell: Callable[[Turn], None],
    wait: Callable[[int], bool],
) -> bool:
    """Take turns until no plan is open, and return whether that came about.

    Nothing is planned again here: that is for whoever may plan for all robots.

    Parameters
    ----------
    graph
        A client in the name of the robot.
    executor
        The robot.
    before
        Called before each turn, to take in what others have moved.
    tell
        Called with each turn in which the robot did something, or lost steps to others.
    wait
        Called with the number of turns in a row without a step; returns whether to look again.
    """
    idle = 0
    while True:
        before()
        turn = executor.turn()
        if turn.result != "idle" or turn.taken:
            tell(turn)
        if turn.result != "idle":
            idle = 0
            continue
        if not graph.call("list_plans", state="open")["plans"]:
            return True
        idle += 1
        if not wait(idle):
            return False
