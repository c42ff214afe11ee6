"""Set-up of a robot in a real browser: from an empty store to a program that recognises."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

import rtask
from endpoint.access.tokens import TokenStore
from features.codec import encode_cloud
from tests.browser.pages import EACH_LOOK, LOOKS, fits, keep_picture, open_page
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

GRIPPER = {"name": "hand", "gripper_type": "planar_hand", "max_opening": "0.1",
           "max_payload": "0.5"}  # fmt: skip
CAMERA = {"name": "eye", "frame_id": "eye_optical", "width": "640", "height": "480", "fx": "554",
          "fy": "554", "min_range": "0.3", "max_range": "2"}  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[RunningServer, str]]:
    folder: Path = tmp_path_factory.mktemp("setup") / "store"
    with rtask.open(folder):  # makes the store, which is empty
        pass
    with closing(TokenStore(folder)) as tokens:
        admin, _ = tokens.create("admin")
    with running_server(folder) as running:
        yield running, admin


def _fill(page: Any, robot: str) -> None:
    page.locator("[name=name]").fill(robot)
    page.locator("[name=model]").fill("planar-1")
    for group, values in (("end_effectors", GRIPPER), ("cameras", CAMERA)):
        for name, value in values.items():
            page.locator(f'[name="{group}.0.{name}"]').fill(value)


def _model(server: RunningServer, token: str) -> bytes:
    headers = {"Authorization": f"Bearer {token}"}
    address = f"{server.url}/datasets/robots/PlanarArm/files/model"
    return httpx.get(address, headers=headers, timeout=60).raise_for_status().content


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_robot_is_described_drawn_and_stored_and_its_program_recognises(
    browser: Any, site: tuple[RunningServer, str], look: str, tmp_path: Path
) -> None:
    server, token = site
    robot = f"arm.{look}"
    model = _model(server, token)
    with open_page(browser, server.url, token, **LOOKS[look]) as page:
        page.goto(f"{server.url}/robots")
        page.get_by_role("link", name="Set up a robot").first.click()
        _fill(page, robot)
        file = {"name": "arm.urdf", "mimeType": "text/xml", "buffer": model}
        page.get_by_label("or its URDF").set_input_files([file])
        page.get_by_text("link4: 3 joints").wait_for()
        assert page.locator("[data-view=robot] .link.inside").count() == 3
        assert page.locator("[data-view=gripper] .label").text_content() == "100 mm"
        assert page.get_by_text("Sees 60° by 47°, from 0.3 to 2 m.").count() == 1
        assert fits(page)
        keep_picture(page, f"setup-{look}")
        page.get_by_role("button", name="Set up").click()
        page.get_by_role("heading", name=f"{robot} is set up").wait_for()
        program = page.locator("[data-program] code").text_content()
        assert len(program.splitlines()) == 12
        assert fits(page)
        page.get_by_role("link", name="pose its arm").click()
        page.locator(".link.goal").first.wait_for()
    headers = {"Authorization": f"Bearer {token}"}
    stored = httpx.get(f"{server.url}/datasets/robots/arm-{look}", headers=headers).json()
    assert (stored["version"], list(stored["files"])) == (1, ["model"])
    described = httpx.get(f"{server.url}/robots.json", headers=headers).json()["robots"]
    assert {"planar_hand"} == {one["grippers"] for one in described if one["name"] == robot}
    rng = np.random.default_rng(3)
    size = np.array([0.09, 0.05, 0.06])  # m
    points = rng.uniform(-0.5, 0.5, (9000, 3)) * size
    face = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), face] = np.sign(rng.uniform(-1, 1, len(points))) * size[face] / 2
    (tmp_path / "view").write_bytes(encode_cloud(points.astype(np.float32)))
    (tmp_path / "robot.py").write_text(program, encoding="utf-8")
    run = [sys.executable, str(tmp_path / "robot.py"), str(tmp_path / "view")]
    said = subprocess.run(run, capture_output=True, text=True, timeout=120, check=False)
    assert "/object/" in said.stdout, said.stderr


def test_a_model_that_cannot_be_read_is_refused_with_its_reason_and_nothing_is_stored(
    browser: Any, site: tuple[RunningServer, str]
) -> None:
    server, token = site
    model = _model(server, token).replace(b'parent link="link1"', b'parent link="lonk"')
    with open_page(browser, server.url, token, expected=("422",)) as page:
        page.goto(f"{server.url}/setup")
        _fill(page, "broken")
        file = {"name": "arm.urdf", "mimeType": "text/xml", "buffer": model}
        page.get_by_label("or its URDF").set_input_files([file])
        page.locator("figcaption").get_by_text("'joint2' names no link: 'lonk'").wait_for()
        page.get_by_role("button", name="Set up").click()
        assert "names no link: 'lonk'" in page.get_by_role("alert").inner_text()
        assert page.locator("[name=name]").input_value() == "broken"
    headers = {"Authorization": f"Bearer {token}"}
    robots = httpx.get(f"{server.url}/robots.json", headers=headers).json()["robots"]
    assert "broken" not in [one["name"] for one in robots]
    known = httpx.get(f"{server.url}/datasets", headers=headers).json()["datasets"]
    assert "robots/broken" not in known


def test_a_stored_model_is_chosen_and_a_gripper_that_cannot_be_is_refused(
    browser: Any, site: tuple[RunningServer, str]
) -> None:
    server, token = site
    with open_page(browser, server.url, token, expected=("400", "422")) as page:
        page.goto(f"{server.url}/setup")
        page.get_by_label("a model that is there").select_option("robots/Panda")
        page.get_by_text("panda_arm: 7 joints").wait_for()
        _fill(page, "second")
        page.locator('[name="end_effectors.0.min_opening"]').fill("0.2")
        page.get_by_role("button", name="Set up").click()
        assert "end_effectors[0]" in page.get_by_role("alert").first.inner_text()
        page.locator('[name="end_effectors.0.min_opening"]').fill("0.01")
        page.get_by_role("button", name="Set up").click()
        page.get_by_role("heading", name="second is set up").wait_for()


@pytest.mark.parametrize("scripts", [True, False], ids=["scripts", "no-scripts"])
def test_a_sensor_is_taken_from_a_camera_info(
    browser: Any, site: tuple[RunningServer, str], scripts: bool
) -> None:
    server, token = site
    info = {"header": {"frame_id": "arm/head_optical"}, "width": 800, "height": 600,
            "K": [700.5, 0, 400, 0, 701.5, 300, 0, 0, 1]}  # fmt: skip
    with open_page(
        browser, server.url, token, expected=("422",), java_script_enabled=scripts
    ) as page:
        page.goto(f"{server.url}/setup")
        page.locator("[name=name]").fill("third")
        for text in ("{", '{"width": 3}', json.dumps({**info, "K": [1, 2]})):
            page.get_by_text("Take it from a camera_info").first.click()
            page.get_by_label("camera_info as YAML or JSON").fill(text)
            page.get_by_role("button", name="Fill in").click()
            page.get_by_text("expected a camera_info as YAML or JSON").wait_for()
            page.goto(f"{server.url}/setup?name=third")
        page.get_by_text("Take it from a camera_info").first.click()
        page.get_by_label("camera_info as YAML or JSON").fill(json.dumps(info))
        page.get_by_role("button", name="Fill in").click()
        page.locator('[name="cameras.0.fx"][value="700.5"]').wait_for()
        fields = ("name", "frame_id", "width", "height", "fy", "cx", "cy")
        shown = {
            field: page.locator(f'[name="cameras.0.{field}"]').input_value() for field in fields
        }
        assert shown == {"name": "head_optical", "frame_id": "arm/head_optical", "width": "800",
                         "height": "600", "fy": "701.5", "cx": "400.0", "cy": "300.0"}  # fmt: skip
        assert page.locator("[name=name]").input_value() == "third"


_ECHOED = """header:
  seq: 12
  stamp: {secs: 5, nsecs: 0}
  frame_id: "arm/head_optical"
height: 600
width: 800
distortion_model: "plumb_bob"
D: [0.0, 0.0, 0.0, 0.0, 0.0]
K: [700.5, 0.0, 400.0, 0.0, 701.5, 300.0, 0.0, 0.0, 1.0]
---
"""
_CALIBRATED = """image_width: 800
image_height: 600
camera_name: head_optical
camera_matrix:
  rows: 3
  cols: 3
  data: [ 700.5,   0. , 400. ,
            0. , 701.5, 300. ,
            0. ,   0. ,   1. ]
distortion_model: plumb_bob
"""


@pytest.mark.parametrize(
    ("text", "frame"),
    [(_ECHOED, "arm/head_optical"), (_CALIBRATED, "")],
    ids=["as rostopic echo prints it", "file of camera_calibration"],
)
def test_a_camera_info_in_yaml_fills_in_the_sensor(
    browser: Any, site: tuple[RunningServer, str], text: str, frame: str
) -> None:
    server, token = site
    with open_page(browser, server.url, token, **LOOKS["phone-dark"]) as page:
        page.goto(f"{server.url}/setup")
        page.get_by_text("Take it from a camera_info").click()
        page.get_by_label("camera_info as YAML or JSON").fill(text)
        page.get_by_role("button", name="Fill in").click()
        page.locator('[name="cameras.0.fx"][value="700.5"]').wait_for()
        shown = {
            field: page.locator(f'[name="cameras.0.{field}"]').input_value()
            for field in ("name", "frame_id", "width", "height", "fy", "cx", "cy")
        }
        assert shown == {"name": "head_optical", "frame_id": frame, "width": "800",
                         "height": "600", "fy": "701.5", "cx": "400.0", "cy": "300.0"}  # fmt: skip
        assert fits(page)


@pytest.mark.parametrize(
    "text",
    [
        '{"width": 64, "height": 48, "k": [60, 0, 0, 0, 60, 0, 31.5, 23.5, 1]}',  # by columns
        "[" * 100_000,
        "[" * 19_000,
        "null",
        "",
        '{"k": 5, "width": 1, "height": 1}',
        "width: [1\n",
        "\x07",
        "K: &k [1, 0, 1, 0, 1, 1, 0, 0, 1]\nwidth: *k\nheight: 1",
        "!!python/object/apply:os.getcwd []",
        "image_width: 3\nimage_height: 2\ncamera_matrix: {data: [1, 2]}",
    ],
    ids=lambda text: repr(text[:12]),
)
def test_what_is_no_camera_info_is_refused_in_words(
    site: tuple[RunningServer, str], text: str
) -> None:
    server, token = site
    headers = {"Authorization": f"Bearer {token}", "Accept": "text/html"}
    form = {"take": "camera_info", "camera_info": text}
    refused = httpx.post(f"{server.url}/setup", data=form, headers=headers)
    assert refused.status_code == 422
    assert "expected a camera_info as YAML or JSON" in refused.text
