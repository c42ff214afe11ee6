"""``rtask simulate tasks``: simulated robots carry out stored plans."""

from __future__ import annotations

import json
from pathlib import Path

import click

from rtask.cli.connection import connection
from rtask.cli.options import agent_option, data_option, server_option
from simulate import options
from simulate.tasks.executor import Turn

__all__ = ["tasks"]


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
@click.option("--decline", metavar="WORDS", help="Say no to steps whose text contains this.")
@options.json_flag("goals and steps")
def tasks(
    words: tuple[str, ...],
    data: Path,
    server: str | None,
    agent: str | None,
    seed: int,
    slip: float,
    decline: str | None,
    as_json: bool,
) -> None:
    """Let simulated robots carry out stored plans, and one for GOAL if it is given.

    The lab is as the graph says, without dynamics: each robot claims steps, looks, acts, reports,
    and what fails is planned again. Exit code 1 unless every goal is reached or declined.
    """
    import numpy as np

    from simulate.tasks.crew import Crew
    from simulate.tasks.executor import Executor
    from simulate.tasks.lab import read_lab

    def tell(robot: str, turn: Turn) -> None:
        turns.append({"robot": robot, "result": turn.result, "step": turn.text,
                      "comment": turn.comment})  # fmt: skip
        if not as_json:
            click.echo(
                f"{turn.result}: {turn.text}" + (f"  ({turn.comment})" if turn.comment else "")
            )

    turns: list[dict[str, str]] = []
    with connection(data, server) as planner:
        lab = read_lab(planner.query, np.random.default_rng(seed), slip)
        if words:
            planner.call("store_plan", goal=" ".join(words), agent=agent)
        robots = {
            robot: Executor(
                planner, lab.robot(robot), robot,
                may=lambda text: not (decline and decline in text),
            )
            for robot in sorted(lab.hands)
        }  # fmt: skip
        ended = Crew(planner, robots, tell, agent).work()
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
    if any(run.result == "given_up" for run in ended):
        raise SystemExit(1)
