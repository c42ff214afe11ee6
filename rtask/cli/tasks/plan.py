"""``rtask plan``: a plan for a goal in words, or why there is none."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.connection import base_of, open_graph, open_to_change
from rtask.cli.options import (
    agent_option,
    announce_undo,
    data_option,
    json_option,
    print_json,
    server_option,
)
from rtask.errors import UsageError

if TYPE_CHECKING:
    from rtask.tasks import TaskPlan

__all__ = ["plan"]


@click.command()
@click.argument("words", nargs=-1, required=True, metavar="GOAL...")
@data_option
@server_option
@agent_option("In whose name --store stores the plan; default: the owner of the store.")
@click.option(
    "--assume-reach", is_flag=True,
    help="Plan as if robots reached places of which that is not known, and say so.",
)  # fmt: skip
@click.option("--because", is_flag=True, help="Print why each precondition of each step holds.")
@click.option("--store", is_flag=True, help="Store the plan as a tree of planned tasks.")
@click.option("--pddl", is_flag=True, help="Print domain and problem for other planners.")
@click.option("--behaviour-tree", is_flag=True, help="Print the XML of BehaviorTree.CPP 4.")
@json_option
def plan(
    words: tuple[str, ...],
    data: Path,
    server: str | None,
    agent: str | None,
    assume_reach: bool,
    because: bool,
    store: bool,
    pddl: bool,
    behaviour_tree: bool,
    as_json: bool,
) -> None:
    """Plan what robots do for a goal such as "every cup into the left box".

    A goal is a sentence, a graph pattern "?x rt:locatedOn IRI WHERE { ... }", or JSON. Exit code 1
    if it cannot be reached; the answer then says what each robot lacks.
    """
    goal = " ".join(words)
    forms = [
        name
        for name, chosen in (("json", as_json), ("pddl", pddl), ("tree", behaviour_tree))
        if chosen
    ]
    if len(forms) > 1:
        raise UsageError("give one of --json, --pddl and --behaviour-tree")
    form = forms[0] if forms else "words"
    if store and server:
        raise UsageError("--store writes to a folder, not to a server")
    if store:
        with open_to_change(data) as kb:
            result = kb.tasks.plan(goal, assume_reach=assume_reach)
            _show(result, form, because)
            if result.steps:
                click.echo(f"stored as {kb.tasks.store(result, agent)}", err=True)
                announce_undo("undo", str(kb.seq))
    else:
        from rtask.tasks.tasks import plan_on

        with open_graph(data, server) as graph:
            result = plan_on(graph, base_of(graph), goal, assume_reach=assume_reach)
        _show(result, form, because)
    if not result.is_complete:
        raise SystemExit(1)


def _show(result: TaskPlan, form: str, because: bool) -> None:
    if form == "json":
        print_json(result.to_dict())
    elif form == "pddl":
        click.echo(result.domain + result.problem, nl=False)
    elif form == "tree":
        from rtask.tasks.behaviour_tree import behaviour_tree

        click.echo(behaviour_tree(result), nl=False)
    else:
        click.echo(result.text)
        if because:
            _show_supports(result)


def _show_supports(result: TaskPlan) -> None:
    for step in result.steps:
        click.echo(f"\n{step.number}. {step.text}, because")
        for item in step.supports:
            if item.step is not None:
                why = f"after step {item.step}"
            elif item.is_assumed:
                why = "assumed"
            elif item.statement is not None:
                why = "rtask explain " + " ".join(f"'<{part}>'" for part in item.statement)
            else:
                why = "as nothing says otherwise"
            click.echo(f"   {item.text}  ({why})")
