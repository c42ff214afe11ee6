"""``rtask simulate tasks``: simulated robots carry out stored plans."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from rtask.cli.connection import connection
from rtask.cli.options import agent_option, data_option, server_option
from rtask.cli.tasks.plan import ASKING_HELP, FAILING_HELP
from rtask.errors import UnknownTermError, UsageError, nearest
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.queue.asking import MAX_PATIENCE_S, PATIENCE_S
from simulate import options
from simulate.tasks.executor import Turn

__all__ = ["tasks"]

_LOOK_S = 1.0
"""How often robots look for answers while they have nothing else to do."""


def _wait() -> bool:
    time.sleep(_LOOK_S)
    return True


def _unless(decline: str | None) -> Callable[[str], bool]:
    return lambda text: not (decline and decline in text)


def _robot_of(graph: Any, name: str) -> str:
    """Return the IRI of a robot with an end effector.

    Raises
    ------
    UnknownTermError
        The graph has none of this name or IRI.
    """
    query = f"""{PREFIXES}SELECT DISTINCT ?robot ?name WHERE {{
  ?robot a cora:Robot ; rt:hasEndEffector ?hand OPTIONAL {{ ?robot rt:name ?name }} }}"""
    robots = {str(row["robot"]): str(row["name"] or row["robot"]) for row in graph.query(query)}
    for iri, own in robots.items():
        if name in (iri, own, iri.rpartition("/")[2]):
            return iri
    hint = nearest(name, sorted(robots.values()))
    raise UnknownTermError(f"--robot: the graph has no robot {name!r} with a hand{hint}")


@click.command()
@click.argument("words", nargs=-1, metavar="[GOAL...]")
@data_option
@server_option
@agent_option("In whose name a plan for GOAL, and those made again, are stored.")
@options.seed("what slips, and where it falls")
@click.option(
    "--slip", type=click.FloatRange(0, 1), default=0.0, show_default=True,
    help="Chance that a thing slips from the hand.",
)  # fmt: skip
@click.option(
    "--partly", is_flag=True,
    help="Do what can be reached of GOAL, and leave the rest open until it can.",
)  # fmt: skip
@click.option("--decline", metavar="WORDS", help="Say no to steps whose text contains this.")
@click.option("--asking-price", type=click.FloatRange(0), help=ASKING_HELP)
@click.option("--failing-price", type=click.FloatRange(0), help=FAILING_HELP)
@click.option(
    "--patience", type=click.FloatRange(0.001, MAX_PATIENCE_S), default=PATIENCE_S,
    show_default=True, help="How long a step waits for the answer of a person, s.",
)  # fmt: skip
@click.option(
    "--robot", metavar="NAME",
    help="Work as this robot alone, while others work elsewhere, until no plan is open.",
)  # fmt: skip
@click.option(
    "--idle", type=click.FloatRange(min=0), default=60.0, show_default=True, metavar="S",
    help="With --robot: leave after this time without a step, s; 0 = never.",
)  # fmt: skip
@options.json_flag("goals and steps")
def tasks(
    words: tuple[str, ...],
    data: Path,
    server: str | None,
    agent: str | None,
    seed: int,
    slip: float,
    partly: bool,
    decline: str | None,
    asking_price: float | None,
    failing_price: float | None,
    patience: float,
    robot: str | None,
    idle: float,
    as_json: bool,
) -> None:
    """Let simulated robots carry out stored plans, and one for GOAL if it is given.

    The lab is as the graph says, without dynamics: each robot claims steps, looks, acts, reports,
    and what fails is planned again, and so is what was left open of a goal. Exit code 1 unless
    every goal is reached or declined.

    With --robot and --server one robot works by itself, with its own token, on any machine; then
    nothing is planned here, and exit code 1 says that plans were left open.
    """
    import numpy as np

    from simulate.tasks.alone import work_alone
    from simulate.tasks.crew import Crew
    from simulate.tasks.executor import Executor, line_of
    from simulate.tasks.lab import places_of, read_lab

    def tell(robot: str, turn: Turn) -> None:
        for record in turn.records(robot):
            turns.append(record)
            if not as_json:
                click.echo(line_of(record))

    turns: list[dict[str, str]] = []
    if robot is not None and words:
        raise UsageError("--robot: one robot plans nothing for all; store the plan by rtask plan")
    with connection(data, server) as planner:
        lab = read_lab(planner.query, np.random.default_rng(seed), slip)
        if robot is not None:
            one = _robot_of(planner, robot)
            may = _unless(decline)
            executor = Executor(planner, lab.robot(one), one, may=may, patience_s=patience)
            is_done = work_alone(
                planner,
                executor,
                lambda: lab.where.update(places_of(planner.query)),
                lambda turn: tell(one, turn),
                lambda times: (not idle or times * _LOOK_S <= idle) and _wait(),
            )
            if as_json:
                click.echo(json.dumps({"done": is_done, "turns": turns}))
            if not is_done:
                raise SystemExit(1)
            return
        if words:
            planner.call(
                "store_plan", goal=" ".join(words), agent=agent,
                asking_price=asking_price, failing_price=failing_price, allow_part=partly,
            )  # fmt: skip
        robots = {
            each: Executor(
                planner, lab.robot(each), each, may=_unless(decline), patience_s=patience
            )
            for each in sorted(lab.hands)
        }  # fmt: skip
        ended = Crew(planner, robots, tell, agent, wait=_wait).work()
    if as_json:
        goals = [
            {"goal": run.goal, "result": run.result, "repairs": run.repairs, "comment": run.comment}
            for run in ended
        ]
        click.echo(json.dumps({"goals": goals, "turns": turns}))
    else:
        for run in ended:
            why = f": {run.comment}" if run.comment else ""
            again = f", planned again {run.repairs} times" if run.repairs else ""
            click.echo(f"{run.goal}: {run.result.replace('_', ' ')}{again}{why}")
    if any(run.result in ("given_up", "partly") for run in ended):
        raise SystemExit(1)
