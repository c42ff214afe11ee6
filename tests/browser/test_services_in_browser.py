"""Forms of services in a real browser, and the code beside them, which is run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.browser.pages import EACH_LOOK, LOOKS, fits, keep_picture, open_page
from tests.browser.waiting import has_count
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SERVICE = '''
"""A service for tests."""
import time
from typing import Annotated, Literal

import cv2
import numpy as np
from annotated_types import Ge, Le

from features.codec import encode_cloud
from rtask.errors import ServiceError
from rtask.services import Call, Service, data_resource, method
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Pose, Unit


class End(Answer):
    """One end of a lever."""

    name: str
    pose: Pose


class Watched(Answer):
    """What was seen."""

    picture: Bytes
    cloud: Bytes
    ends: list[End]
    path: list[Array]


class Lever(Service):
    """Levers and what they lift."""

    name = "lab/Lever"
    version = "1.2.0"
    parts = data_resource("binary", default="robots/Point", summary="parts of the lever")

    @method(output="force")
    def lift(
        self,
        load: Annotated[float, Unit("kg"), Ge(0), Le(100)],
        arms: Array,
        method: Literal["near", "far"] = "near",
    ) -> Annotated[float, Unit("N")]:
        """Return the force that lifts a load.

        Parameters
        ----------
        load
            Mass of the load.
        arms
            Lengths of the two arms, m.
        method
            Which end is held.
        """
        if len(arms) != 2:
            raise ServiceError("a lever has two arms")
        return load * 9.81 * (arms[0] / arms[1] if method == "near" else arms[1] / arms[0])

    @method(effect="reads")
    def watch(self, call: Call, seconds: Annotated[float, Unit("s"), Ge(0), Le(600)]) -> Watched:
        """Watch the lever and show what was seen.

        Parameters
        ----------
        seconds
            How long to watch.
        """
        call.progress(0.5, "half seen")
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            call.check_cancelled()
            time.sleep(0.01)
        grid = np.stack(np.meshgrid(*[np.linspace(0, 0.1, 12)] * 3), axis=-1).reshape(-1, 3)
        colours = np.full((len(grid), 3), 90, np.uint8)
        _, picture = cv2.imencode(".png", np.zeros((4, 6, 3), np.uint8))
        return Watched(
            picture=picture.tobytes(),
            cloud=encode_cloud(grid.astype(np.float32), colours),
            ends=[End(name="left", pose=np.eye(4)), End(name="<b>right</b>", pose=np.eye(4))],
            path=[np.array([0.0, 1.0]), np.array([0.5, 0.5])],
        )
'''


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder: Path = tmp_path_factory.mktemp("services")
    (folder / "lever.py").write_text(SERVICE, encoding="utf-8")
    with running_server(folder / "store", "--service", str(folder / "lever.py")) as running:
        yield running


def _answer(page: Any) -> Any:
    return json.loads(page.locator("[data-json]").text_content())


@pytest.mark.parametrize("look", EACH_LOOK)
def test_a_method_is_called_by_its_form_and_by_the_code_beside_it(
    browser: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser, server.url, java_script_enabled=False, **LOOKS[look]) as page:
        page.goto(f"{server.url}/services")
        assert fits(page)
        page.get_by_role("link", name="lab/Lever").click()
        page.get_by_label("load (kg) *").fill("10")
        page.get_by_label("arms *").fill("[0.5, 1.0]")
        page.get_by_label("method", exact=True).select_option("far")
        page.get_by_role("button", name="Call").click()
        assert _answer(page) == {"force": pytest.approx(196.2)}
        assert page.get_by_label("load (kg) *").input_value() == "10"
        assert fits(page)
        keep_picture(page, f"service-{look}")
        if look != "phone-dark":
            return
        code = {
            name: page.locator(f'pre[data-language="{name}"] code').text_content()
            for name in ("curl", "Python", "roslibpy", "JavaScript")
        }
    said = [
        subprocess.run(["bash", "-c", code["curl"]], capture_output=True, text=True, check=True),
        subprocess.run(
            [sys.executable, "-c", code["Python"]], capture_output=True, text=True, check=True
        ),
    ]
    for one in said:
        assert "196.2" in one.stdout, one.stderr
    assert f'fetch("{server.url}/services/lab/Lever@1.2.0/lift"' in code["JavaScript"]
    silent = {**os.environ, "PYTHONWARNINGS": "ignore"}
    ros = subprocess.run(
        [sys.executable, "-c", code["roslibpy"]],
        capture_output=True, text=True, env=silent, timeout=60, check=False,
    )  # fmt: skip
    assert "196.2" in ros.stdout, ros.stderr


def test_a_wrong_value_is_said_at_its_field_and_nothing_typed_is_lost(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, expected=("422", "400"), java_script_enabled=False) as page:
        page.goto(f"{server.url}/services/lab/Lever")
        page.get_by_label("load (kg) *").fill("10")
        page.get_by_label("arms *").fill('["a"]')
        page.get_by_role("button", name="Call").click()
        field = page.locator("p.field").filter(has=page.get_by_label("arms *"))
        assert "arms" in field.get_by_role("alert").inner_text()
        assert page.get_by_label("arms *").get_attribute("aria-invalid") == "true"
        page.get_by_label("arms *").fill("[1, 2, 3]")
        page.get_by_role("button", name="Call").click()
        has_count(page.get_by_text("a lever has two arms"), 1)
        assert page.get_by_label("load (kg) *").input_value() == "10"


def test_a_built_in_service_is_called_by_its_form(browser: Any, server: RunningServer) -> None:
    with open_page(browser, server.url) as page:
        page.goto(f"{server.url}/services/example/Grasping")
        page.get_by_label("polygon *").fill("[[0,0],[0.06,0],[0.06,0.03],[0,0.03]]")
        page.get_by_label("grasps").fill("3")
        page.get_by_role("button", name="Call").click()
        assert len(_answer(page)["grasps"]) == 3


@pytest.mark.parametrize("look", EACH_LOOK)
def test_pictures_clouds_poses_and_curves_are_shown_as_such(
    browser: Any, server: RunningServer, look: str
) -> None:
    with open_page(browser, server.url, **LOOKS[look]) as page:
        page.goto(f"{server.url}/services/lab/Lever?$method=watch")
        page.get_by_label("seconds (s) *").fill("0")
        page.get_by_role("button", name="Call").click()
        page.locator("[data-place][data-drawn]").wait_for()  # the cloud
        page.locator("[data-poses] .arrow").first.wait_for()
        assert page.locator("[data-poses] .arrow").count() == 2
        assert page.locator("img.shown").evaluate("one => one.naturalWidth") == 6
        assert page.locator("[data-curves] .curve").count() == 2
        assert page.get_by_role("cell", name="<b>right</b>").count() == 1
        assert fits(page)
        keep_picture(page, f"answer-{look}")


def test_an_answer_is_read_without_scripts(browser: Any, server: RunningServer) -> None:
    with open_page(browser, server.url, java_script_enabled=False) as page:
        page.goto(f"{server.url}/services/lab/Lever?$method=watch")
        page.get_by_label("seconds (s) *").fill("0")
        page.get_by_role("button", name="Call").click()
        assert "1728 points" in page.locator("main").inner_text()
        has_count(page.get_by_role("cell", name="at 0, 0, 0 m, turned 0, 0, 0, 1"), 2)


def test_a_call_as_a_job_shows_its_progress_and_is_cancelled(
    browser: Any, server: RunningServer
) -> None:
    with open_page(browser, server.url, **LOOKS["phone-dark"]) as page:
        page.goto(f"{server.url}/services/lab/Lever?$method=watch")
        page.get_by_label("seconds (s) *").fill("600")
        page.get_by_role("button", name="Run as a job").click()
        page.get_by_text("50 %: half seen").wait_for()
        assert page.locator("progress").evaluate("one => one.value") == 0.5
        assert fits(page)
        page.get_by_role("button", name="Cancel").click()
        page.get_by_text("cancelled", exact=True).wait_for()
        page.get_by_role("link", name="Jobs").first.click()
        page.get_by_role("heading", name="Jobs").wait_for()
        has_count(page.get_by_role("cell", name="cancelled"), 1)
        page.goto(f"{server.url}/services/lab/Lever?$method=watch")
        page.get_by_label("seconds (s) *").fill("0")
        page.get_by_label("dataset for parts").fill("robots/PlanarArm@1")
        page.get_by_role("button", name="Run as a job").click()
        page.locator("[data-poses] .arrow").first.wait_for()  # the page of its answer


def test_programs_get_the_same_addresses_as_json(server: RunningServer) -> None:
    names = [one["name"] for one in httpx.get(f"{server.url}/services").json()["services"]]
    assert "lab/Lever" in names
    described = httpx.get(f"{server.url}/services/lab/Lever").json()
    assert described["methods"]["lift"]["output"] == "force"
    page = httpx.get(f"{server.url}/services/lab/Levre", headers={"Accept": "text/html"})
    assert page.status_code == 404
    assert "did you mean" in page.text


def test_the_form_of_every_method_answers_a_blank_form_in_words(server: RunningServer) -> None:
    """Either it works without a value, or a field says what it lacks; no form is broken."""
    listed = httpx.get(f"{server.url}/services", timeout=60).json()["services"]
    with httpx.Client(headers={"Accept": "text/html"}, timeout=120) as client:
        for name in (one["name"] for one in listed):
            address = f"{server.url}/services/{name}"
            methods = httpx.get(address, timeout=60).json()["methods"]
            for method in methods:
                where = f"{name}/{method}"
                shown = client.get(address, params={"$method": method})
                assert shown.status_code == 200, where
                assert f'value="{method}"' in shown.text, where
                sent = client.post(address, data={"$method": method})
                assert sent.status_code in (200, 400, 403, 404, 409, 422, 501), (where, sent.text)
                assert sent.status_code == 200 or 'role="alert"' in sent.text, where
