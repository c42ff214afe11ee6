"""Every command that prints a listing bounds it by ``--limit``, and says what it leaves out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

import ontology
import rtask
from rtask.cli import main
from tests.rtask.cli.each.tree import walk_commands

_WITHOUT = {
    "prints a few lines about what it made, changed or moved": """
        backup, branch drop, branch make, branch merge,
        contributors withdraw, dataset create, dataset get, dataset merge, dataset prune,
        dataset put, dataset remove, dataset restore, dataset snapshot, episodes export,
        episodes import, migrate, model generate, objects forget, objects merge, objects mesh,
        objects name,
        objects split, objects undo, ontology docs, promote, proposals adopt, proposals refuse,
        questions answer, rebuild, restore, robot add, robot reach, robot remove,
        robot restore, ros messages,
        ros2 dds save, ros2 package, rules add, rules remove, service save, simulate fetch,
        simulate film, simulate ros-reach, tasks cancel, teach, token create, token expire,
        token revoke, undo, update, grasp train""",
    "prints a line for each file that it is given": "load",
    "prints one thing, which is of no use in part: a proof, a plan, a rule, a file, an answer": """
        explain, plan, why, simulate why, rules show, ontology path, robot srdf, simulate urdf,
        help, service show, service call, ros2 dds call, tasks tree""",
    "prints a line for each of its own checks": "doctor, ros doctor, ros2 doctor, robot check",
    "prints a line for each object in one picture": "recognise, segment, camera",
    "writes all of it, as a file": "export, world export",
    "is bounded by LIMIT in the query": "query",
    "tabulates the trials that its options ask for": """
        demo, simulate tasks, simulate crew, learn benchmark, service benchmark,
        simulate act-test place,
        simulate act-test reach, simulate act-test workspace, study asking-price, study attempts,
        study day, study demo,
        study grasp-quality, study grasp-views, study grasping, study hands, study judging,
        study learn, study paths, study piles, study push-grasps, study requests,
        study sharing, study table4, study table5, study tasks, study trust, study unforeseen,
        study why, thesis all, thesis show""",
    "runs until it is interrupted, or as long as a program of the user": """
        mcp, worker, ros node, ros2 node, ros2 dds serve, service run, simulate act-serve,
        simulate ros, simulate ros2""",
}
"""Commands without the option, by the reason."""
_DATA = f"""
PREFIX rt: <{ontology.NS}> PREFIX rdfs: <{ontology.PREFIXES["rdfs"]}>
INSERT DATA {{
  <urn:mug-1> a rt:Mug ; rt:objectId "1" ; rt:name "blue mug" ;
    rt:hasView <urn:v1>, <urn:v2>, <urn:v3> .
  <urn:mug-2> a rt:Mug ; rt:objectId "2" ; rt:name "red mug" .
  <urn:mug-3> a rt:Mug ; rt:objectId "3" ; rt:name "green mug" .
}}"""
Run = Callable[..., tuple[int, str, str]]
pytestmark = pytest.mark.slow


def test_each_command_has_the_option_limit_or_a_reason_to_have_none() -> None:
    names = [name.strip() for group in _WITHOUT.values() for name in group.split(",")]
    without = {
        name
        for name, command in walk_commands()
        if not any("--limit" in parameter.opts for parameter in command.params)
    }
    assert sorted(names) == sorted(without)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("limits") / "kb"
    with rtask.open(folder, base="urn:lab/") as kb:
        kb.update(_DATA, "nao-1")
        kb.update("INSERT DATA { <urn:a> <urn:p> 1 }", "nao-1")
        kb.add_rules(
            [
                rtask.Rule(name, f"CONSTRUCT {{ ?a <urn:{name}> ?b }} WHERE {{ ?a <urn:p> ?b }}")
                for name in ("first", "second")
            ]
        )
    return folder


@pytest.fixture
def run(made: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as caught:
            main(list(arguments))
        out, err = capsys.readouterr()
        return int(caught.value.code or 0), out, err

    return call


_LISTINGS = (
    ("stats", "-d"), ("history", "-d"), ("objects", "list", "-d"),
    ("objects", "show", "blue mug", "-d"), ("ontology", "list", "-d"), ("search", "mug", "-d"),
    ("rules", "list", "-d"), ("ontology", "show"), ("ontology", "show", "grasp"),
    ("ontology", "show", "-d"), ("ontology", "patches"), ("episodes", "ask"),
    ("robot", "list"), ("service", "list"),
)  # fmt: skip


@pytest.mark.parametrize("arguments", _LISTINGS, ids=" ".join)
def test_a_listing_of_one_entry_counts_the_others_and_names_the_way_to_all(
    run: Run, made: Path, arguments: tuple[str, ...]
) -> None:
    given = [*arguments, *([str(made)] if arguments[-1] == "-d" else [])]
    code, whole, err = run(*given, "--limit", "0")
    assert (code, err) == (0, "")
    code, part, err = run(*given, "--limit", "1")
    assert code == 0
    assert len(part.splitlines()) < len(whole.splitlines())
    numbers = [int(line.split()[0]) for line in err.splitlines()]
    assert all(number > 0 for number in numbers)
    assert numbers
    assert all(line.endswith("; --limit 0 for all") for line in err.splitlines())
    code, part, err = run(*given, "--limit", "1", "--json")
    assert (code, err) == (0, "")
    assert json.loads(part)["not_shown"] == sum(numbers)
    assert "not_shown" not in run(*given, "--json")[1]


def test_json_that_was_bounded_says_that_nothing_is_left_out_where_that_is_so(
    run: Run, made: Path
) -> None:
    _, out, _ = run("objects", "list", "-d", str(made), "--limit", "3", "--json")
    document = json.loads(out)
    assert (len(document["rows"]), document["not_shown"]) == (3, 0)


def test_the_check_of_data_lists_what_speaks_most_against_them_first(
    run: Run, made: Path, tmp_path: Path
) -> None:
    shapes = tmp_path / "shapes.ttl"
    shapes.write_text(f"""
PREFIX sh: <http://www.w3.org/ns/shacl#> PREFIX rt: <{ontology.NS}>
<urn:S> a sh:NodeShape ; sh:targetClass rt:Mug ; sh:severity sh:Warning ; sh:property
  [ sh:path rt:mass ; sh:minCount 1 ; sh:severity sh:Warning ] ,
  [ sh:path rt:hasView ; sh:minCount 3 ; sh:severity sh:Violation ] .""")
    code, out, err = run("validate", "-d", str(made), "--shapes", str(shapes), "--limit", "1")
    assert code == 1
    assert out.startswith("Violation")
    assert err.endswith("more; --limit 0 for all\n")
