"""The recorded demo: what is shipped, what a bare installation shows, and how a run is packed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path

import httpx
import pytest

import rtask
from rtask.asking.terms import reader_of
from rtask.errors import RtaskError, UsageError
from rtask.extras import EXTRA_OF
from rtask.kb.store.naming import Names, prefixed
from rtask.rdf.terms import Literal, NamedNode, stored, written
from simulate.demo.recorded import MARK, RECORDED, pack, unpack

_MESHES = {".stl", ".dae", ".obj", ".ply", ".urdf", ".gltf", ".glb"}
_HERE = str(Path(__file__).parents[3]).encode()
_OF_A_MACHINE = (b"/tmp/", b"/home/", b"/root/", b"localhost:", b"127.0.0.1", _HERE)


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the recorded demo that is shipped."""
    folder = tmp_path_factory.mktemp("recorded") / "demo"
    unpack(folder)
    return folder


def test_what_is_shipped_is_small_and_holds_nothing_of_a_machine_or_of_others() -> None:
    assert RECORDED.stat().st_size < 3_000_000
    with tarfile.open(RECORDED) as tar:
        entries = tar.getmembers()
        assert not _MESHES & {Path(entry.name).suffix.lower() for entry in entries}
        assert {(entry.uid, entry.uname, entry.gname, entry.mtime) for entry in entries} == {
            (0, "", "", 0)
        }
        for entry in entries:
            file = tar.extractfile(entry)
            text = b"" if file is None else file.read()
            assert not [word for word in _OF_A_MACHINE if word in text], entry.name


def test_the_recorded_store_names_its_products_as_the_report_does(opened: Path) -> None:
    result = json.loads((opened / MARK).read_text("utf-8"))
    assert [robot["name"] for robot in result["robots"]] == ["nao-1", "nao-2", "panda-3"]
    with rtask.open(opened / "store", mode="r") as kb:
        rows = kb.query(
            "PREFIX rt: <https://w3id.org/rtask-kg/ns#> "
            "SELECT DISTINCT ?name { ?object rt:objectId ?id ; rt:name ?name }"
        )
        named = {row["name"].value for row in rows}
        paths = kb.query('ASK { ?s ?p ?o FILTER(REGEX(STR(?o), "^/(tmp|work|home|root)/")) }')
    assert {met["product"] for met in result["objects"]} <= named
    assert paths is False


def test_every_printed_form_of_every_term_of_the_recorded_store_is_read_back(
    opened: Path,
) -> None:
    with rtask.open(opened / "store", mode="r") as kb:
        reader, names = reader_of(kb), Names(kb.store, kb.graphs)
        terms = {term for quad in kb.match() for term in quad}
        assert {type(term) for term in terms} >= {NamedNode, Literal}
        for term in terms:
            if isinstance(term, NamedNode):
                for form in {written(term), term.value, prefixed(term, kb.base), names(term)}:
                    assert reader.term(form, "subject") == term, form
            elif isinstance(term, Literal):
                for form in {written(term), prefixed(term, kb.base)}:
                    assert stored(reader.term(form)) == term, form


@pytest.mark.slow
def test_a_bare_installation_shows_pages_pictures_and_answers(tmp_path: Path) -> None:
    """No library of any extra can be imported, by the command or by the server that it starts."""
    blocked = f"import sys; sys.modules.update(dict.fromkeys({sorted(EXTRA_OF)}))\n"
    (tmp_path / "sitecustomize.py").write_text(blocked, "utf-8")
    process = subprocess.Popen(
        [sys.executable, "-m", "rtask", "demo", "--recorded"],
        cwd=tmp_path, stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    assert process.stdout is not None
    try:
        lines: list[str] = []
        for line in process.stdout:
            lines.append(line.rstrip("\n"))
            if line.startswith("Ctrl-C"):
                break
        told = dict(line.split(maxsplit=1) for line in lines if line.count("/") > 1)
        with httpx.Client(headers={"Accept": "text/html"}, timeout=60) as client:
            home = client.get(told["pages"])
            film = client.get(told["film"].split()[0])
            thing = client.get(told["object"])
            answer = client.get(told["ask"])
    finally:
        process.terminate()
        process.wait(60)
        process.stdout.close()
    assert any(line.startswith("With the graph nao-2") for line in lines)
    assert {page.status_code for page in (home, film, thing, answer)} == {200}
    assert "carton-" in thing.text
    assert "<img" in film.text
    report = tmp_path / told["report"]
    assert "carton-" in report.read_text("utf-8")
    assert (tmp_path / "rtask-recorded/store").is_dir()


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(UsageError, match="holds no recorded demo"):
        unpack(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_what_was_judged_since_stays_in_a_recorded_demo(tmp_path: Path) -> None:
    unpack(tmp_path / "demo")
    (tmp_path / "demo/store/judged").write_text("held")
    assert unpack(tmp_path / "demo")["store"] == str(tmp_path / "demo/store")
    assert (tmp_path / "demo/store/judged").exists()


def test_a_recorded_demo_that_cannot_be_unpacked_whole_leaves_nothing(tmp_path: Path) -> None:
    cut = tmp_path / "cut.tar.xz"
    cut.write_bytes(RECORDED.read_bytes()[:-100_000])
    with pytest.raises((EOFError, tarfile.TarError)):
        unpack(tmp_path / "demo", cut)
    assert [path.name for path in tmp_path.iterdir()] == ["cut.tar.xz"]


def test_an_installation_without_the_recorded_demo_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(RtaskError, match="--record FILE"):
        unpack(tmp_path / "demo", tmp_path / "absent.tar.xz")
    assert not (tmp_path / "demo").exists()


@pytest.mark.slow
def test_a_run_is_packed_without_the_folder_in_which_it_ran(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "run/store", reason=False) as kb:
        kb.update("INSERT DATA { GRAPH <urn:g> { <urn:carton> <urn:on> <urn:table> } }")
    result = {
        "store": str(tmp_path / "run/store"), "url": "http://127.0.0.1:1", "objects": [],
        "robots": [],
    }  # fmt: skip
    (tmp_path / "run/report/nao-1").mkdir(parents=True)
    (tmp_path / "run/report/report.json").write_text(json.dumps(result), "utf-8")
    (tmp_path / "run/report/nao-1/01-1-closed.jpg").write_bytes(b"picture")
    pack(tmp_path / "run", tmp_path / "packed.tar.xz")
    shown = unpack(tmp_path / "shown", tmp_path / "packed.tar.xz")
    assert (shown["url"], shown["store"]) == ("", str(tmp_path / "shown/store"))
    texts = [path.read_bytes() for path in (tmp_path / "shown").rglob("*") if path.is_file()]
    assert not [text for text in texts if str(tmp_path).encode() in text]
    assert (tmp_path / "shown/report/nao-1/01-1-closed.jpg").read_bytes() == b"picture"
    with rtask.open(tmp_path / "shown/store", mode="r") as kb:
        assert kb.query("ASK { GRAPH ?g { <urn:carton> <urn:on> <urn:table> } }")
