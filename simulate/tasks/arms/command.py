"""``rtask simulate crew``: whole simulated robots carry out a goal at shared tables."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.connection import connection
from rtask.cli.options import agent_option, data_option, server_option
from rtask.errors import UsageError
from simulate import options

if TYPE_CHECKING:
    from simulate.tasks.arms.bench import Bench
    from simulate.tasks.arms.film import BenchFilm
    from simulate.tasks.arms.introducing import Planner
    from simulate.tasks.arms.working import Settings, Truth
    from simulate.tasks.crew import Ended
    from simulate.tasks.executor import Turn

__all__ = ["crew"]


@click.command()
@click.argument("words", nargs=-1, metavar="GOAL...")
@data_option
@server_option
@agent_option("In whose name plans are stored.")
@click.option(
    "--table", "tables", multiple=True, default=("sorting",), show_default=True,
    help="sorting: two Naos and a Panda at one table; or a kind of robot at a table of its own. "
    "Several tables: say it again.",
)  # fmt: skip
@click.option(
    "--things", type=click.IntRange(1, 8), default=4, show_default=True,
    help="Things on each table.",
)  # fmt: skip
@options.seed("things, light and noise")
@click.option(
    "--partly", is_flag=True,
    help="Do what can be reached of GOAL, and leave the rest open until it can.",
)  # fmt: skip
@click.option("--decline", metavar="WORDS", help="Say no to steps whose text contains this.")
@click.option(
    "--film", type=click.Path(path_type=Path, dir_okay=False), metavar="OUT",
    help="Film the first table to a .webp, .png or .gif file.",
)  # fmt: skip
@click.option(
    "--robot", metavar="NAME",
    help="Be this robot alone, at a table of its own (--table), and carry out what others plan.",
)  # fmt: skip
@click.option(
    "--idle", type=click.FloatRange(min=0), default=60.0, show_default=True, metavar="S",
    help="With --robot: leave after this time without a step, s; 0 = never.",
)  # fmt: skip
@options.preset
@options.json_flag("goals, steps, and where things truly are")
def crew(
    words: tuple[str, ...], data: Path, server: str | None, agent: str | None,
    tables: tuple[str, ...], things: int, seed: int, partly: bool, decline: str | None,
    film: Path | None, robot: str | None, idle: float, preset: str, as_json: bool,
) -> None:  # fmt: skip
    """Let whole robots carry out GOAL, such as every can into the left box.

    Arms, hands and cameras are in physics. The robots look what stands on their tables, ask for a
    plan, and carry it out: look, recognise, choose a grasp with the graph, move, lift, put down,
    judge. What fails is planned again. A step takes some 3 to 10 s of one core. Exit code 1 unless
    the goal is reached or declined.

    With --robot the program is one robot with its table, its things and its token: it looks what
    stands there, waits for a plan, and takes its steps until no plan is open. Exit code 1 says then
    that a plan was left open.
    """
    from simulate.tasks.arms.working import Settings, crew_at_tables, layouts_of
    from simulate.tasks.executor import line_of
    from simulate.world.animation import check_film
    from simulate.world.quiet import banner_on_stderr

    _check_use(words, robot, film, partly)
    if film is not None:
        check_film(film)
    layouts_of(tables, robot or "")
    goal, turns = " ".join(words), list[dict[str, str]]()
    films: list[BenchFilm] = []

    def tell(robot: str, turn: Turn) -> None:
        for record in turn.records(robot):
            turns.append(record)
            if not as_json:
                click.echo(line_of(record))

    def may(text: str) -> bool:
        for film_of_table in films:
            film_of_table.doing = text
        return not (decline and decline in text)

    with connection(data, server, creates=True) as planner, banner_on_stderr():
        planner.call("list_plans")  # so that a server out of reach is no news after a minute
        settings = Settings(tables, things, seed, preset, robot or "")
        if robot is not None:
            ended: list[Ended] = []
            is_done, truths = _alone(planner, settings, tell, may, idle, as_json)
        else:
            with crew_at_tables(planner, settings, _filming(film, goal, films)) as working:
                planner.call("store_plan", goal=goal, agent=agent, allow_part=partly)
                ended = working.work(tell, may, agent)
                truths = working.truths()
                if film is not None:
                    films[0].write(film, "; ".join(run.result.replace("_", " ") for run in ended))
            is_done = all(run.result in ("reached", "declined") for run in ended)
    # Only here: within, what goes to standard output is taken for the banner of the physics.
    _print(ended, turns, [(t.name, t.remembered, t.place) for t in truths], as_json)
    if not is_done:
        raise SystemExit(1)


def _check_use(words: tuple[str, ...], robot: str | None, film: Path | None, partly: bool) -> None:
    if robot is None and not words:
        raise UsageError("give a goal, such as every can into the left box; or --robot NAME")
    if robot is not None and (words or film is not None or partly):
        raise UsageError("--robot: one robot plans nothing for all; store the plan by rtask plan")


def _alone(
    graph: Planner, settings: Settings, tell: Callable[[str, Turn], None],
    may: Callable[[str], bool], idle: float, as_json: bool,
) -> tuple[bool, list[Truth]]:  # fmt: skip
    """Be one robot until no plan is open; return whether that came about, and where things are."""
    from simulate.tasks.alone import await_plan, work_alone
    from simulate.tasks.arms.working import crew_at_tables
    from simulate.tasks.executor import Executor

    def wait(times: int) -> bool:
        if idle and times * _LOOK_S > idle:
            return False
        time.sleep(_LOOK_S)
        return True

    with crew_at_tables(graph, settings) as working:
        [(iri, body)] = working.bodies.items()
        for item in working.things:
            place = body.places.get(body.find(item) or "", "")
            click.echo(f"{iri} sees {item}" + (f" on {place}" if place else ""), err=as_json)
        executor = Executor(graph, body, iri, may=may)
        is_done = await_plan(graph, wait) and work_alone(
            graph, executor, lambda: None, lambda turn: tell(iri, turn), wait
        )
        return is_done, working.truths()


_LOOK_S = 0.5
"""Between two looks for a step."""


def _filming(path: Path | None, goal: str, films: list[BenchFilm]) -> Callable[[Bench], None]:
    """Return what begins the film of the first table."""

    def begin(bench: Bench) -> None:
        from simulate.tasks.arms.film import BenchFilm

        if path is not None and not films:
            films.append(BenchFilm(bench, goal))

    return begin


def _print(
    ended: list[Ended], turns: list[dict[str, str]], where: list[tuple[str, str, str]],
    as_json: bool,
) -> None:  # fmt: skip
    wrong = [name for name, remembered, place in where if remembered and remembered != place]
    if as_json:
        goals = [
            {"goal": run.goal, "result": run.result, "repairs": run.repairs, "comment": run.comment}
            for run in ended
        ]
        placed = [{"name": n, "remembered": r, "truly": p} for n, r, p in where]
        click.echo(json.dumps({"goals": goals, "turns": turns, "things": placed}))
        return
    for run in ended:
        why = f": {run.comment}" if run.comment else ""
        again = f", planned again {run.repairs} times" if run.repairs else ""
        click.echo(f"{run.goal}: {run.result.replace('_', ' ')}{again}{why}")
    click.echo(
        f"in the physics {len(where) - len(wrong)} of {len(where)} things are where the graph has "
        "them, or it does not say"
    )
