"""The wheel is complete: it runs in an environment of its own, away from the checkout."""

from __future__ import annotations

import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from tests.architecture.imports import PACKAGES, ROOT
from tests.packaging.crawling import crawl
from tests.packaging.distributions import Distributions, build_distributions, faults
from tests.packaging.installation import Installation, install
from tests.servers import running_server

pytestmark = pytest.mark.slow
BESIDE_THE_WHEEL = "beside the wheel, pip install './rtask_kg-0.1.0-py3-none-any.whl[{}]'"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Distributions:
    return build_distributions(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def wheel(built: Distributions) -> Path:
    return built.wheel


@pytest.fixture(scope="module")
def base(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """An installation of the wheel without extras."""
    return install(wheel, tmp_path_factory.mktemp("base") / "venv")


def _readme_examples() -> str:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return "\n".join(re.findall(r"```python\n(.*?)```", text, re.S))


def test_sdist_and_wheel_are_complete_and_an_index_would_take_them(built: Distributions) -> None:
    assert faults(built) == []


def test_a_release_without_a_page_or_with_wrong_metadata_is_refused(
    built: Distributions, tmp_path: Path
) -> None:
    page = "endpoint/pages/static/style.css"
    broken = tmp_path / built.wheel.name
    with zipfile.ZipFile(built.wheel) as whole, zipfile.ZipFile(broken, "w") as rest:
        for name in whole.namelist():
            content = whole.read(name)
            if name.endswith("/METADATA"):
                content = content.replace(b"Requires-Python: ", b"Requires-Python: about ")
            if name != page:
                rest.writestr(name, content)
    said = faults(replace(built, wheel=broken))
    assert said[0] == f"the wheel lacks {page}"
    assert "'about >=3.11' is invalid for 'requires-python'" in said[1]
    assert len(said) == 2


def test_every_package_comes_from_the_installation(base: Installation, tmp_path: Path) -> None:
    program = f"import {', '.join(PACKAGES)}\nfor m in ({', '.join(PACKAGES)}): print(m.__file__)"
    done = base.run("python", "-c", program, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert all(Path(line).is_relative_to(base.packages) for line in done.stdout.splitlines())


def test_the_base_runs_the_examples_of_the_readme(base: Installation, tmp_path: Path) -> None:
    done = base.run("python", "-W", "error", "-c", _readme_examples(), folder=tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_base_serves_queries_and_registers_robots(base: Installation, tmp_path: Path) -> None:
    store = tmp_path / "store"
    sample = ROOT / "ontology" / "examples" / "sample.trig"
    loaded = base.run("rtask", "load", sample, "-d", store, folder=tmp_path)
    assert loaded.returncode == 0, loaded.stderr
    command = [str(base.rtask)]
    with running_server(store, command=command, environment=base.environment) as server:
        query = "PREFIX rt: <https://w3id.org/rtask-kg/ns#> ASK { ?mug rt:objectId 'lab/mug-1' }"
        answer = httpx.get(f"{server.url}/sparql", params={"query": query})
        assert answer.json()["boolean"] is True
        assert "mug" in httpx.get(f"{server.url}/objects").text
        hand = {"name": "hand", "gripper_type": "nao", "max_opening": 0.05, "max_payload": 0.3}
        robot = {"name": "nao-1", "model": "nao-h25-v5", "end_effectors": [hand]}
        assert httpx.post(f"{server.url}/engine/register_robot", json=robot).status_code == 200
        refused = httpx.post(f"{server.url}/engine/search_object", json={"data": "eA=="})
        assert refused.status_code == 501, refused.text
        assert refused.json()["type"] == "/errors/missing-extra"
        assert BESIDE_THE_WHEEL.format("perception") in refused.json()["detail"]


# The sample names a picture that it does not bring, and operators sign in first.
_EXPECTED = {("/api/blobs/", 404), ("/admin/", 401)}


@pytest.mark.parametrize(
    ("extras", "count"),
    [((), 150), pytest.param(("perception", "surfaces"), 150, marks=pytest.mark.deep)],
)
def test_every_link_of_every_page_leads_somewhere_with_any_extras(
    wheel: Path, base: Installation, tmp_path: Path, extras: tuple[str, ...], count: int
) -> None:
    there = install(wheel, tmp_path / "venv", *extras) if extras else base
    sample = ROOT / "ontology" / "examples" / "sample.trig"
    loaded = there.run("rtask", "load", sample, "-d", tmp_path / "store", folder=tmp_path)
    assert loaded.returncode == 0, loaded.stderr
    command = [str(there.rtask)]
    with running_server(
        tmp_path / "store", command=command, environment=there.environment
    ) as server:
        visits = crawl(server.url)
    lacking = [visit for visit in visits if visit.status == 501]
    assert not [visit.address for visit in lacking if "pip install" not in visit.text]
    assert bool(lacking) is not bool(extras)
    services = next(visit.text for visit in visits if visit.address == "/services")
    lacks = set(re.findall(r"needs the extra &#39;(\w+)&#39;", services))
    # Trials of failures need the simulation, which is in neither.
    assert lacks == {"perception", "surfaces", "simulate"} - set(extras)
    dead = {
        (visit.address, visit.linked_from, visit.status)
        for visit in visits
        if visit.status not in (200, 501)
        and not any(
            visit.address.startswith(start) and visit.status == status
            for start, status in _EXPECTED
        )
    }
    assert not dead
    assert len(visits) >= count


_STUDIES = ("simulate/study/", "simulate/thesis/", "simulate/fleet/")
_MODULES = """import atexit, os, sys
from pathlib import Path
def write(to=Path(sys.argv.pop(1))):
    (to / str(os.getpid())).write_text("\\n".join(sys.modules))
atexit.register(write)
from rtask.cli import main
main()
"""
"""Runs a command, and writes into a folder which modules each process had loaded at its end."""


def test_studies_weigh_little_in_the_wheel_and_nothing_in_the_base(
    wheel: Path, base: Installation, tmp_path: Path
) -> None:
    with zipfile.ZipFile(wheel) as archive:
        sizes = {entry.filename: entry.compress_size for entry in archive.infolist()}
    studies = sum(size for name, size in sizes.items() if name.startswith(_STUDIES))
    assert 0 < studies < 0.1 * sum(sizes.values())
    (told := tmp_path / "modules").mkdir()
    command = [str(base.folder / "bin" / "python"), "-c", _MODULES, str(told)]
    store = tmp_path / "store"
    with running_server(store, command=command, environment=base.environment) as server:
        assert httpx.get(f"{server.url}/").status_code == 200
        answer = httpx.get(f"{server.url}/sparql", params={"query": "ASK { ?s ?p ?o }"})
        assert answer.json()["boolean"] is True
    asked = base.run(command[0], *command[1:], "stats", "-d", store, folder=tmp_path)
    assert asked.returncode == 0, asked.stderr
    loaded = {name for file in told.iterdir() for name in file.read_text().splitlines()}
    assert {"rtask.kb.core", "endpoint.server"} <= loaded, "what was loaded is not told"
    folders = tuple(folder.replace("/", ".") for folder in _STUDIES)
    assert not sorted(name for name in loaded if f"{name}.".startswith(folders))
    for name in ("study", "thesis"):
        done = base.run("rtask", name, folder=tmp_path)
        assert done.returncode == 3
        assert f"rtask {name} needs the extra 'simulate'" in done.stderr


def test_the_base_says_which_extra_a_demo_needs(base: Installation, tmp_path: Path) -> None:
    done = base.run("rtask", "demo", folder=tmp_path)
    wanted = f"rtask demo needs the extra 'simulate': {BESIDE_THE_WHEEL.format('simulate')}"
    assert done.returncode == 3
    assert done.stderr.startswith(f"rtask: {wanted}; `rtask demo --recorded`")


def test_the_base_shows_the_recorded_demo(base: Installation, tmp_path: Path) -> None:
    done = base.run("rtask", "demo", "--recorded", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["gains"]
    assert (tmp_path / "rtask-recorded/report/report.html").exists()


@pytest.mark.deep
def test_a_robot_learns_two_objects_with_everything_installed(wheel: Path, tmp_path: Path) -> None:
    whole = install(wheel, tmp_path / "venv", "all")
    demo = ["demo", "--objects", "2", "--robots", "1", "--json"]
    done = whole.run("rtask", *demo, folder=tmp_path, timeout_s=280)
    assert done.returncode == 0, done.stderr[-2000:]
    assert json.loads(done.stdout)
