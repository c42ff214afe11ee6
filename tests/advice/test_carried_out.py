"""What an error recommends is carried out, word by word; what had failed then works."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

import ontology
import rtask
from rtask.cli import main
from tests.servers import ServerDidNotStartError, running_server
from tests.sparql_servers import OXIGRAPH, Oxigraph

pytestmark = pytest.mark.slow

_ADVICE = re.compile(r"rtask [a-z][^`;,\n]*")
_PREFIX = f"PREFIX rt: <{ontology.NS}>"
Ran = tuple[int, str]


@dataclass(frozen=True)
class Situation:
    """A call that fails, and the advice that its error gives.

    Parameters
    ----------
    fails
        The call, without ``rtask``; ``DIR`` is the folder of a knowledge base.
    more
        Arguments that the recommended command needs, and that its reader chooses.
    works
        What works afterwards; by default the call that failed.
    ends
        Exit code of the recommended command and of what works: 1 where both find nothing.
    prepare
        Brings the folder into the situation.
    """

    fails: str
    more: str = ""
    works: str = ""
    ends: int = 0
    prepare: Callable[[Path], None] = lambda folder: None


def _mug(folder: Path) -> None:
    with rtask.open(folder) as kb:
        kb.update(
            f'{_PREFIX} INSERT DATA {{ <urn:lab/mug> a rt:Mug ; rt:objectId "7" ; rt:name "mug" }}'
        )


def _damage_store(folder: Path) -> None:
    _mug(folder)
    for file in (folder / "store").glob("*.sst"):
        file.write_bytes(b"no table")
    (folder / "store" / "CURRENT").write_text("MANIFEST-999999\n")


def _change_journal(folder: Path) -> None:
    _mug(folder)
    last = max((folder / "journal").iterdir())
    last.write_bytes(last.read_bytes()[:-3])


def _rules(folder: Path) -> None:
    text = "# rule: above\nCONSTRUCT { ?a <urn:above> ?b } WHERE { ?a <urn:on> ?b }"
    (folder.parent / "rules.rq").write_text(text)


def _other_rule(folder: Path) -> None:
    _rules(folder)
    with rtask.open(folder) as kb:
        kb.add_rules(folder.parent / "rules.rq")
    text = "# rule: above\nCONSTRUCT { ?b <urn:above> ?a } WHERE { ?a <urn:under> ?b }"
    (folder.parent / "rules.rq").write_text(text)


def _view(folder: Path) -> None:
    ink = np.random.default_rng(0)
    picture = ink.integers(0, 255, (240, 320, 3), dtype=np.uint8)
    cv2.imwrite(str(folder.parent / "mug.png"), cv2.GaussianBlur(picture, (0, 0), 2))


def _files(folder: Path) -> None:
    (folder.parent / "facts.nt").write_text("<urn:a> <urn:p> <urn:b> .\n")


SITUATIONS = {
    "no tokens": Situation("token list --data DIR", more="--data DIR --role admin"),
    "no objects": Situation(
        "objects list --data DIR", more="cup PICTURE --data DIR", prepare=_view
    ),
    "no such object": Situation(
        "objects show teapot --data DIR", more="--data DIR", works="objects show mug --data DIR",
        prepare=_mug,
    ),
    "no such proposal": Situation(
        "proposals show 7 --data DIR", more="--data DIR", works="proposals list --data DIR",
        ends=1,
    ),
    "no rules": Situation(
        "rules list --data DIR", more="RULES --data DIR", prepare=_rules
    ),
    "another rule": Situation(
        "rules add RULES --data DIR", more="RULES --data DIR", prepare=_other_rule
    ),
    "LOAD": Situation(
        "update --data DIR 'LOAD <file:///x>'", more="FACTS --data DIR",
        works="query --data DIR 'ASK { ?s <urn:p> ?o }'", prepare=_files,
    ),
    "damaged store": Situation("stats --data DIR", prepare=_damage_store),
    "changed journal": Situation("stats --data DIR", prepare=_change_journal),
}  # fmt: skip


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[[str], Ran]:
    names = {"DIR": "kb", "PICTURE": "mug.png", "RULES": "rules.rq", "FACTS": "facts.nt"}
    places = {name: str(tmp_path / place) for name, place in names.items()}

    def call(command: str) -> Ran:
        arguments = [places.get(word, word) for word in shlex.split(command)]
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        out, err = capsys.readouterr()
        return int(ended.value.code or 0), err + out

    return call


@pytest.mark.parametrize("name", SITUATIONS)
def test_the_recommended_command_mends_what_failed(
    name: str, run: Callable[[str], Ran], tmp_path: Path
) -> None:
    situation = SITUATIONS[name]
    rtask.open(tmp_path / "kb").close()
    situation.prepare(tmp_path / "kb")
    code, said = run(situation.fails)
    assert code != 0
    (advice,) = set(_ADVICE.findall(said))
    command = advice.removeprefix("rtask ").strip()
    code, answered = run(f"{command} {situation.more}")
    assert code == situation.ends, f"{command}: {answered}"
    code, answered = run(situation.works or situation.fails)
    assert code == situation.ends, answered


def _refused(folder: Path, *options: str) -> str:
    """Return the command that a server recommends which does not start."""
    with (
        pytest.raises(ServerDidNotStartError, match="no token exists") as stopped,
        running_server(folder, "--behind-proxy", *options),
    ):
        pass
    (advice,) = set(_ADVICE.findall(str(stopped.value)))
    return advice.removeprefix("rtask ").strip()


def test_a_server_behind_a_proxy_starts_once_the_recommended_token_is_made(
    run: Callable[[str], Ran], tmp_path: Path
) -> None:
    assert run(_refused(tmp_path / "kb"))[0] == 0
    with running_server(tmp_path / "kb", "--behind-proxy"):
        pass


@pytest.mark.deep
@pytest.mark.skipif(OXIGRAPH is None, reason="needs the command oxigraph")
def test_so_does_one_whose_statements_are_on_another_server(
    run: Callable[[str], Ran], tmp_path: Path
) -> None:
    store = Oxigraph(tmp_path / "ox")
    store.start()
    try:
        assert run(_refused(tmp_path / "kb", "--store", store.address))[0] == 0
        with running_server(tmp_path / "kb", "--behind-proxy", "--store", store.address):
            pass
        # A folder that keeps its statements itself is refused, and the way out works.
        rtask.open(tmp_path / "own").close()
        with (
            pytest.raises(ServerDidNotStartError, match="a folder of its own") as stopped,
            running_server(tmp_path / "own", "--store", store.address),
        ):
            pass
        (advice,) = set(_ADVICE.findall(str(stopped.value)))
        command = advice.removeprefix("rtask ").replace("URL", shlex.quote(store.address))
        command = command.replace("FOLDER", str(tmp_path / "new"))
        assert run(f"{command} --role admin")[0] == 0
        with running_server(tmp_path / "new", "--behind-proxy", "--store", store.address):
            pass
    finally:
        store.kill()
