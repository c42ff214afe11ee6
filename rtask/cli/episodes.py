"""``rtask episodes``: what robots did, saw and judged, out of a graph and into another."""

from __future__ import annotations

import datetime as dt
from dataclasses import asdict
from pathlib import Path

import click

from rtask.cli.changing.new_folder import open_or_make
from rtask.cli.connection import open_to_read
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
from rtask.cli.progress import Working
from rtask.errors import UsageError

_EXTRA = "rtask episodes"


@click.group()
def episodes() -> None:
    """Attempts with all that belongs to them, as recordings or LeRobot data sets, and back."""


def _time(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> dt.datetime | None:
    if text is None:
        return None
    try:
        time = dt.datetime.fromisoformat(text)
    except ValueError:
        raise click.BadParameter(f"{text!r} is no time of ISO 8601") from None
    if time.tzinfo is None:
        raise click.BadParameter(f"{text!r} has no time zone; write {text}Z")
    return time


def _query(context: click.Context, parameter: click.Parameter, text: str | None) -> str | None:
    if text is None or not text.startswith("@"):
        return text
    try:
        return Path(text[1:]).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise click.BadParameter(f"{text[1:]}: {error}") from None


_select = click.option(
    "--select",
    "query",
    callback=_query,
    metavar="SPARQL",
    help="Only those that this SELECT names as ?attempt; @FILE reads it from a file.",
)
_since = click.option(
    "--since", callback=_time, help="Only those that ended then or later (ISO 8601)."
)


@episodes.command("list")
@data_option
@agent_option("Only those of this robot.")
@_since
@_select
@listing_option
@json_option
def list_episodes(
    data: Path,
    agent: str | None,
    since: dt.datetime | None,
    query: str | None,
    limit: int | None,
    as_json: bool,
) -> None:
    """List attempts: when, who, with what, and what the robot judged."""
    from rtask.interop.episodes.episode import episodes_of

    with open_to_read(data) as kb:
        recorded = episodes_of(kb, robot=agent, since=since, query=query)
    recorded = shown_rows(recorded, limit, as_json, newest=True)
    if as_json:
        print_json([episode.to_json() for episode in recorded])
    for episode in [] if as_json else recorded:
        judged = {True: "held", False: episode.reason or "not held", None: "not judged"}[
            episode.held
        ]
        placed = ", placed" if episode.placed else ""
        time = episode.ended.isoformat(timespec="seconds")
        click.echo(f"{time}  {episode.robot_name:16} {episode.thing_name:20} {judged}{placed}")
    exit_if_empty(recorded, "no attempts")


@episodes.command()
@click.argument("out", type=click.Path(path_type=Path))
@data_option
@agent_option("Only those of this robot.")
@_since
@_select
@click.option(
    "--format",
    "-F",
    "form",
    type=click.Choice(["mcap", "bag", "lerobot"]),
    help="Form of OUT; a data set of LeRobot is a folder.  [default: by OUT's extension]",
)
@click.option("--hand", help="Only those with this end effector (lerobot).")
@click.option("--rate", default=20, show_default=True, type=click.IntRange(1, 200),
              help="Rows per second (lerobot).")  # fmt: skip
@click.option("--urdf", type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="Description of the robot, for viewers (mcap, bag).")  # fmt: skip
@json_option
def export(
    out: Path,
    data: Path,
    agent: str | None,
    since: dt.datetime | None,
    query: str | None,
    form: str | None,
    hand: str | None,
    rate: int,
    urdf: Path | None,
    as_json: bool,
) -> None:
    """Write attempts to OUT: .mcap, .bag of ROS 1, or a data set of LeRobot.

    A viewer of recordings shows the pictures, the views with depth, the joints, and each attempt as
    JSON; `rtask recognise` and `rtask segment` read the views. A data set (format v3.0) has the
    joints and commands of the attempts for which robots recorded them, and the command says how
    many had none. `rtask episodes import` loses nothing from either.
    """
    from rtask.extras import naming_extras
    from rtask.interop.episodes.episode import episodes_of
    from rtask.interop.episodes.lerobot import write_lerobot
    from rtask.interop.episodes.recording import write_episodes

    if form in ("mcap", "bag") and out.suffix != f".{form}":
        raise UsageError(f"--format {form}: expected a file that ends in .{form}, got {out}")
    with open_to_read(data) as kb, naming_extras(_EXTRA):
        recorded = episodes_of(kb, robot=agent, since=since, query=query)
        exit_if_empty(recorded, "no attempt fits; see `rtask episodes list`")
        with Working("writing") as working:
            if form == "lerobot":
                written = write_lerobot(kb, recorded, out, rate, hand, working.tell)
            else:
                described = "" if urdf is None else urdf.read_text("utf-8")
                written = write_episodes(kb, recorded, out, working.tell, described)
    if as_json:
        made = {key: value for key, value in asdict(written).items() if key != "doubts"}
        print_json({"path": str(out), **made})
        return
    for reason in written.left_out:
        click.echo(f"{out}: {reason}", err=True)
    click.echo(
        f"{out}: {written.episodes} episodes, {written.pictures} pictures, {written.views} views, "
        f"{written.motions} motions, {written.statements} statements"
    )


@episodes.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@data_option
@agent_option("Import as this robot: a file in which another one acts is refused.")
@json_option
def import_episodes(file: Path, data: Path, agent: str | None, as_json: bool) -> None:
    """Add the episodes of FILE (.mcap, .bag, or an exported data set) to the graph, in one commit.

    A file in which one robot says what another, or a person, did is refused.
    Counts, beliefs and hidden causes are then restated from all attempts, in a second one. What
    is known already changes nothing.
    """
    if not file.exists():  # before a knowledge base is made for what is not there
        raise UsageError(f"{file}: there is no such file")
    from rtask.engine import Engine
    from rtask.extras import naming_extras
    from rtask.interop.episodes.reading import read_episodes
    from rtask.kb.commit.access import Access

    with open_or_make(data) as kb, naming_extras(_EXTRA), Working("reading"):
        before = kb.seq
        read = read_episodes(kb, file, Access(agent, "robot") if agent else None)
        commit = kb.seq
        if commit != before:
            with Engine(kb) as engine:
                engine.rebuild_statistics()
    counted = ("episodes", "statements", "blobs")
    counts = {key: value for key, value in asdict(read).items() if key in counted}
    if as_json:
        print_json({"path": str(file), **counts, "doubts": read.doubts})
        return
    for doubt in read.doubts:
        click.echo(f"{file}: {doubt}", err=True)
    click.echo(f"{read.episodes} episodes, {read.statements} statements, {read.blobs} binary data")
    if commit != before:
        announce_undo("undo", str(commit))


@episodes.command()
@click.argument("number", type=int, required=False)
@data_option
@server_option
@listing_option
@json_option
def ask(
    number: int | None, data: Path, server: str | None, limit: int | None, as_json: bool
) -> None:
    """Answer a question about what robots did; without NUMBER list the questions.

    With --json, an answer is a list of objects, one a row. The queries are files to start from.
    Exit code 1 if there is no answer.
    """
    import ontology
    from rtask.cli.connection import open_graph

    files = ontology.episode_queries()
    texts = [file.read_text("utf-8") for file in files]
    questions = [text.partition("\n")[0].removeprefix("# question: ") for text in texts]
    if number is None:
        rows = [
            {"number": k, "question": question, "file": str(file)}
            for k, (question, file) in enumerate(zip(questions, files, strict=True), 1)
        ]
        rows = shown_rows(rows, limit, as_json)
        if as_json:
            print_json(rows)
        for row in () if as_json else rows:
            click.echo(f"{row['number']:3d}  {row['question']}")
        return
    if not 1 <= number <= len(files):
        raise UsageError(f"there are questions 1 to {len(files)}, not {number}")
    with open_graph(data, server) as kb:
        answers = shown_rows(kb.select(texts[number - 1]).to_dicts(), limit, as_json)
    if as_json:
        print_json(answers)
    else:
        click.echo(questions[number - 1], err=True)
    for answer in () if as_json else answers:
        click.echo("\t".join("" if value is None else str(value) for value in answer.values()))
    exit_if_empty(answers)
