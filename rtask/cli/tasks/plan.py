"""``rtask plan``: a plan for a goal in words, or why there is none."""

from __future__ import annotations

import datetime as dt
import shlex
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.cli.connection import connection, open_branch, open_to_change, open_to_read
from rtask.cli.options import (
    agent_option,
    announce_undo,
    announce_why,
    branch_option,
    data_option,
    json_option,
    print_json,
    server_option,
)
from rtask.errors import UsageError
from rtask.rdf.terms import moment
from rtask.tasks.questions.price import Prices
from rtask.tasks.storing import Order

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["ASKING_HELP", "FAILING_HELP", "plan"]

ASKING_HELP = "What a question to a person costs, in any unit; without, nobody is asked."
FAILING_HELP = "What a step that fails costs, in the unit of --asking-price."


@click.command()
@click.argument("words", nargs=-1, required=True, metavar="GOAL...")
@data_option
@server_option
@branch_option
@agent_option("In whose name --store stores the plan; default: the owner of the store.")
@click.option(
    "--assume-reach", is_flag=True,
    help="Plan as if robots reached places of which that is not known, and say so.",
)  # fmt: skip
@click.option(
    "--because",
    is_flag=True,
    help="Print why each precondition of each step holds, and each chance.",
)
@click.option("--store", is_flag=True, help="Store the plan as a tree of planned tasks.")
@click.option(
    "--partly", is_flag=True,
    help="With --store: store what can be reached, and leave the rest open until it can.",
)  # fmt: skip
@click.option(
    "--priority", type=click.IntRange(-100, 100), default=0, show_default=True,
    help="With --store: plans with a greater one are begun first.",
)  # fmt: skip
@click.option("--deadline", metavar="TIME", help="With --store: no step is begun later, ISO 8601.")
@click.option("--asking-price", type=click.FloatRange(0), help=f"With --store: {ASKING_HELP}")
@click.option("--failing-price", type=click.FloatRange(0), help=f"With --store: {FAILING_HELP}")
@click.option("--pddl", is_flag=True, help="Print domain and problem for other planners.")
@click.option("--behaviour-tree", is_flag=True, help="Print the XML of BehaviorTree.CPP 4.")
@json_option
def plan(
    words: tuple[str, ...],
    data: Path,
    server: str | None,
    branch: str | None,
    agent: str | None,
    assume_reach: bool,
    because: bool,
    store: bool,
    partly: bool,
    priority: int,
    deadline: str | None,
    asking_price: float | None,
    failing_price: float | None,
    pddl: bool,
    behaviour_tree: bool,
    as_json: bool,
) -> None:
    """Plan what robots do for a goal such as "every cup into the left box".

    A goal is a sentence, a graph pattern "?x rt:locatedOn IRI WHERE { ... }", or JSON. Exit code 1
    if it cannot be reached; the answer then says what each robot lacks.
    """
    forms = [
        name
        for name, chosen in (("json", as_json), ("pddl", pddl), ("tree", behaviour_tree))
        if chosen
    ]
    if len(forms) > 1:
        raise UsageError("give one of --json, --pddl and --behaviour-tree")
    form = forms[0] if forms else "words"
    goal = {"goal": " ".join(words), "assume_reach": assume_reach, "branch": branch}
    if branch and store and server:
        raise UsageError("--store in a branch needs a folder; a server plans in a branch alone")
    prices = _prices(asking_price, failing_price)
    if (priority or deadline or prices or partly) and not store:
        raise UsageError("--partly, --priority, --deadline and prices are for --store")
    due = None if deadline is None else moment(deadline)
    order = Order(priority, due, prices=prices, allows_part=partly) if store else None
    if server:
        result = _plan_there(goal, server, agent, order, form)
    else:
        result = _plan_here(goal, data, agent, order, form)
    _show(result, form, because, assume_reach)
    if "task" in result:
        click.echo(f"stored as {result['task']}", err=True)
        if result["refusals"]:
            click.echo("What is not possible is left open, and planned again later.", err=True)
        if result["late_s"]:
            click.echo(
                f"Warning: begun now, it is expected to end {result['late_s']:.0f} s after its "
                "deadline, when no further step is begun.",
                err=True,
            )
        announce_undo(*(("branch", "drop", branch) if branch else ("undo", result["commit"])))
    if not result["complete"]:
        raise SystemExit(1)


def _prices(asking: float | None, failing: float | None) -> Prices | None:
    if asking is None and failing is None:
        return None
    if asking is None or failing is None:
        raise UsageError("give --asking-price and --failing-price, or neither")
    return Prices(asking, failing)


def _plan_here(
    goal: dict[str, Any], data: Path, agent: str | None, order: Order | None, form: str
) -> dict[str, Any]:
    """Return the plan of a folder as the operation answers it; with an order, store its steps."""
    from rtask.engine.operations.tasks.plan import answer_of

    with _opened(data, goal["branch"], order is not None) as kb:
        plan = kb.tasks.plan(goal["goal"], assume_reach=goal["assume_reach"])
        answer = answer_of(plan, pddl=form == "pddl", tree=form == "tree").as_json()
        if order and (plan.steps or _leaves_open(order, answer)):
            order = order.due_by(plan.deadline)
            task = kb.tasks.store(plan, agent, order)
            late_s = order.late_s(plan.duration_s, dt.datetime.now(dt.UTC))
            answer |= {"task": task, "commit": str(kb.seq), "late_s": round(late_s, 3)}
    return answer


def _leaves_open(order: Order, answer: dict[str, Any]) -> bool:
    """Whether goals that are out of reach are to be stored."""
    return order.allows_part and bool(answer["refusals"])


def _opened(
    data: Path, branch: str | None, is_changed: bool
) -> AbstractContextManager[KnowledgeBase]:
    if branch:
        return open_branch(data, None, branch)
    return open_to_change(data) if is_changed else open_to_read(data)


def _plan_there(
    goal: dict[str, Any], server: str, agent: str | None, order: Order | None, form: str
) -> dict[str, Any]:
    """Return the plan of a server; with an order, store that very plan."""
    with connection(Path(), server) as client:
        forms = {"pddl": form == "pddl", "behaviour_tree": form == "tree"}
        answer = dict(client.call("plan_goal", **goal, **forms))
        if order and (answer["steps"] or _leaves_open(order, answer)):
            due = None if order.deadline is None else order.deadline.timestamp()
            stored = client.call(
                "store_plan", goal=goal["goal"], assume_reach=goal["assume_reach"],
                digest=answer["digest"], agent=agent,
                priority=order.priority, deadline=due,
                asking_price=order.prices and order.prices.asking,
                failing_price=order.prices and order.prices.failing,
                allow_part=order.allows_part,
            )  # fmt: skip
            answer |= {name: stored[name] for name in ("task", "commit", "late_s")}
    return answer


def _show(result: dict[str, Any], form: str, because: bool, assume_reach: bool) -> None:
    if form == "json":
        print_json(result)
    elif form == "pddl":
        click.echo(result["domain"] + result["problem"], nl=False)
    elif form == "tree":
        click.echo(result["behaviour_tree"], nl=False)
    else:
        click.echo(result["text"])
        if because:
            _show_supports(result)
        elif result["steps"]:
            asked = ["--assume-reach"] if assume_reach else []
            announce_why("plan", result["goal"], *asked, "--because")


def _show_supports(result: dict[str, Any]) -> None:
    for step in result["steps"]:
        click.echo(f"\n{step['step']}. {step['text']}, because")
        asked = shlex.join(["rtask", "query", _in_one_line(step["outcomes"])])
        click.echo(f"   chance {step['chance']:.2f}: {step['why']}  ({asked})")
        for item in step["because"]:
            if item["step"] is not None:
                why = f"after step {item['step']}"
            elif item["assumed"]:
                why = "assumed"
            elif item["statement"] is not None:
                why = "rtask explain " + " ".join(f"'<{part}>'" for part in item["statement"])
            else:
                why = "as nothing says otherwise"
            click.echo(f"   {item['text']}  ({why})")


def _in_one_line(sparql: str) -> str:
    """Return a query without comments and the prefixes that the command line predefines."""
    lines = (line for line in sparql.splitlines() if not line.startswith(("PREFIX ", "#")))
    return " ".join(" ".join(lines).split())
