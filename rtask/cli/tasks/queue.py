"""``rtask tasks``: stored plans, who does what and why, and cancelling one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from rtask.cli.connection import connection
from rtask.cli.options import (
    agent_option,
    data_option,
    json_option,
    listing_option,
    print_change,
    print_listing,
    server_option,
)
from rtask.cli.things import name_or_iri
from rtask.errors import UnknownTermError

__all__ = ["tasks"]


@click.group()
def tasks() -> None:
    """Stored plans: list them with who does what, print one as a tree, or cancel one."""


@tasks.command("list")
@click.option("--all", "everything", is_flag=True, help="Also those done, cancelled or replaced.")
@data_option
@server_option
@listing_option
@json_option
def list_(
    everything: bool, data: Path, server: str | None, limit: int | None, as_json: bool
) -> None:
    """List stored plans with their steps, who does what, and why.

    Exit code 1 if there is none.
    """
    with connection(data, server) as client:
        plans = client.call("list_plans", state="all" if everything else "open")["plans"]
    nothing = "no plan is stored" if everything else "no plan is open"
    print_listing(plans, limit, as_json, _in_words, nothing)


@tasks.command()
@click.argument("plan", metavar="PLAN")
@data_option
@server_option
def tree(plan: str, data: Path, server: str | None) -> None:
    """Print the stored plan with the IRI PLAN as XML of BehaviorTree.CPP 4.

    The steps have the robots and hands that they are assigned to now: robots with nothing to do
    take over what others have not begun.
    """
    plan = name_or_iri(plan, data, server)
    with connection(data, server) as client:
        plans = client.call("list_plans", state="all", behaviour_tree=True)["plans"]
    stored = next((item for item in plans if item["task"] == plan), None)
    if stored is None:
        raise UnknownTermError(f"there is no stored plan {plan}")
    click.echo(stored["behaviour_tree"], nl=False)


@tasks.command()
@click.argument("plan", metavar="PLAN")
@click.option("--reason", required=True, help="Why.")
@data_option
@server_option
@agent_option("Person who cancels it; a server knows it from the token.")
@json_option
def cancel(
    plan: str, reason: str, data: Path, server: str | None, agent: str | None, as_json: bool
) -> None:
    """Cancel the stored plan with the IRI PLAN: no further step of it is begun."""
    plan = name_or_iri(plan, data, server)
    with connection(data, server) as client:
        done = client.call("cancel_plan", plan=plan, reason=reason, operator=agent)
    print_change(done, as_json, f"{plan} is cancelled", f"{plan} was cancelled before")


def _in_words(plan: Mapping[str, Any]) -> str:
    more = f", priority {plan['priority']}" if plan["priority"] else ""
    more += f", cancelled: {plan['cancelled']}" if plan["cancelled"] else ""
    lines = [f"{plan['goal']}  ({plan['state']}{more})\n  {plan['task']}"]
    for step in plan["steps"]:
        lines.append(f"{step['step']:5}. {step['text']}  ({step['state']})")
        # A claim says why it is its robot's; what is not begun yet has nothing else to say so.
        why = step["why"] or step["assignment"]
        lines += [f"         {words}" for words in (why, step["comment"]) if words]
    lines += [f"       left open: {text}" for text in plan["open_goals"]]
    return "\n".join(lines)
