"""``rtask simulate crew``: whole simulated robots carry out a goal at shared tables."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.connection import connection
from rtask.cli.options import agent_option, data_option, server_option
from simulate import options

if TYPE_CHECKING:
    from simulate.tasks.arms.bench import Bench
    from simulate.tasks.arms.film import BenchFilm
    from simulate.tasks.crew import Ended
    from simulate.tasks.executor import Turn

__all__ = ["crew"]


@click.command()
@click.argument("words", nargs=-1, metavar="GOAL...", required=True)
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
@options.preset
@options.json_flag("goals, steps, and where things truly are")
def crew(
    words: tuple[str, ...], data: Path, server: str | None, agent: str | None,
    tables: tuple[str, ...], things: int, seed: int, partly: bool, decline: str | None,
    film: Path | None, preset: str, as_json: bool,
) -> None:  # fmt: skip
    """Let whole robots carry out GOAL, such as every can into the left box.

    Arms, hands and cameras are in physics. The robots look what stands on their tables, ask for a
    plan, and carry it out: look, recognise, choose a grasp with the graph, move, lift, put down,
    judge. What fails is planned again. A step takes some 3 to 10 s of one core. Exit code 1 unless
    the goal is reached or declined.
    """
    from simulate.tasks.arms.working import Settings, crew_at_tables, layouts_of
    from simulate.world.animation import check_film
    from simulate.world.quiet import banner_on_stderr

    if film is not None:
        check_film(film)
    layouts_of(tables)
    goal, turns = " ".join(words), list[dict[str, str]]()
    films: list[BenchFilm] = []

    def tell(robot: str, turn: Turn) -> None:
        about = {"result": turn.result, "step": turn.text, "comment": turn.comment}
        turns.append({"robot": robot, **about})
        why = f"  ({turn.comment})" if turn.comment else ""
        if not as_json:
            click.echo(f"{turn.result}: {turn.text}{why}")

    def may(text: str) -> bool:
        for film_of_table in films:
            film_of_table.doing = text
        return not (decline and decline in text)

    with connection(data, server, creates=True) as planner, banner_on_stderr():
        planner.call("list_plans")  # so that a server out of reach is no news after a minute
        settings = Settings(tables, things, seed, preset)
        with crew_at_tables(planner, settings, _filming(film, goal, films)) as working:
            planner.call("store_plan", goal=goal, agent=agent, allow_part=partly)
            ended = working.work(tell, may, agent)
            truths = working.truths()
            if film is not None:
                films[0].write(film, "; ".join(run.result.replace("_", " ") for run in ended))
    _print(ended, turns, [(t.name, t.remembered, t.place) for t in truths], as_json)
    if any(run.result in ("given_up", "partly") for run in ended):
        raise SystemExit(1)


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
