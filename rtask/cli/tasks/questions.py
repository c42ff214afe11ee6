"""``rtask questions``: what robots ask people, and answering."""

from __future__ import annotations

import time
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
    nothing = "no robot asked anything" if everything else "no question is open"
    print_listing(asked, limit, as_json, _in_words, nothing)


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
    print_change(done, as_json, "the robot takes up its step again", "you answered so before")


def _in_words(question: Mapping[str, Any]) -> str:
    state = question["state"]
    if state == "open":
        state = f"open for {max(question['until'] - time.time(), 0):.0f} s"
    lines = [f"{question['robot_name']}: {question['text']}  ({state})\n  {question['question']}"]
    for choice in question["choices"]:
        number = choice["number"]
        mark = ""
        if number == question["chosen"]:
            mark = f"  <- {question['answered_by']}"
        elif number == question["otherwise"] and not question["chosen"]:
            mark = "  (if nobody answers)"
        lines.append(f"{number:5}. {choice['text']}{mark}")
    return "\n".join([*lines, f"       {question['reason']}"])
