"""``rtask questions``: what robots ask people, and answering."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from rtask.cli.connection import connection
from rtask.cli.options import (
    agent_option,
    announce_undo,
    data_option,
    exit_if_empty,
    json_option,
    listing_option,
    print_json,
    server_option,
    shown_rows,
)
from rtask.cli.things import name_or_iri

__all__ = ["questions"]


@click.group()
def questions() -> None:
    """What robots ask people about their steps: list it, or answer."""


@questions.command("list")
@click.option("--all", "everything", is_flag=True, help="Also those that nobody waits for now.")
@data_option
@server_option
@listing_option
@json_option
def list_(
    everything: bool, data: Path, server: str | None, limit: int | None, as_json: bool
) -> None:
    """List questions with the answers to choose from, and why they were asked.

    Exit code 1 if there is none.
    """
    with connection(data, server) as client:
        state = "all" if everything else "open"
        asked = client.call("list_questions", state=state)["questions"]
    shown = shown_rows(asked, limit, as_json)
    if as_json:
        print_json(shown)
    else:
        for question in shown:
            _show(question)
    exit_if_empty(asked, "no robot asked anything" if everything else "no question is open")


@questions.command()
@click.argument("question", metavar="QUESTION")
@click.argument("choice", type=click.IntRange(1), metavar="NUMBER")
@click.option("--remark", help="What you say besides.")
@data_option
@server_option
@agent_option("Person who answers; a server knows it from the token.")
@json_option
def answer(
    question: str,
    choice: int,
    remark: str | None,
    data: Path,
    server: str | None,
    agent: str | None,
    as_json: bool,
) -> None:
    """Answer the question with the IRI QUESTION by the choice NUMBER."""
    question = name_or_iri(question, data, server)
    with connection(data, server) as client:
        done = client.call(
            "answer_question", question=question, choice=choice, remark=remark, operator=agent
        )
    if as_json:
        print_json(dict(done))
    elif done["commit"]:
        click.echo("the robot takes up its step again")
        announce_undo("undo", done["commit"])
    else:
        click.echo("you answered so before")


def _show(question: dict[str, Any]) -> None:
    state = question["state"]
    if state == "open":
        state = f"open for {max(question['until'] - time.time(), 0):.0f} s"
    click.echo(f"{question['robot_name']}: {question['text']}  ({state})\n  {question['question']}")
    for choice in question["choices"]:
        number = choice["number"]
        mark = ""
        if number == question["chosen"]:
            mark = f"  <- {question['answered_by']}"
        elif number == question["otherwise"] and not question["chosen"]:
            mark = "  (if nobody answers)"
        click.echo(f"{number:5}. {choice['text']}{mark}")
    click.echo(f"       {question['reason']}")
