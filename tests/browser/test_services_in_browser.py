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

from tests.browser.pages import LOOKS, fits, keep_picture, open_page
from tests.servers import RunningServer, running_server

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SERVICE = '''
"""A service for tests."""
from typing import Annotated, Literal

from annotated_types import Ge, Le

from rtask.errors import ServiceError
from rtask.services import Service, method
from rtask.wire.types import Array, Unit


class Lever(Service):
    """Levers and what they lift."""

    name = "lab/Lever"
    version = "1.2.0"

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
'''


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder: Path = tmp_path_factory.mktemp("services")
    (folder / "lever.py").write_text(SERVICE, encoding="utf-8")
    with running_server(folder / "store", "--service", str(folder / "lever.py")) as running:
        yield running


def _answer(page: Any) -> Any:
    return json.loads(page.get_by_role("status").inner_text())


@pytest.mark.parametrize("look", LOOKS)
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
        assert page.get_by_text("a lever has two arms").count() == 1
        assert page.get_by_label("load (kg) *").input_value() == "10"


def test_a_built_in_service_is_called_by_its_form(browser: Any, server: RunningServer) -> None:
    with open_page(browser, server.url) as page:
        page.goto(f"{server.url}/services/example/Grasping")
        page.get_by_label("polygon *").fill("[[0,0],[0.06,0],[0.06,0.03],[0,0.03]]")
        page.get_by_label("grasps").fill("3")
        page.get_by_role("button", name="Call").click()
        assert len(_answer(page)["grasps"]) == 3


def test_programs_get_the_same_addresses_as_json(server: RunningServer) -> None:
    names = [one["name"] for one in httpx.get(f"{server.url}/services").json()["services"]]
    assert "lab/Lever" in names
    described = httpx.get(f"{server.url}/services/lab/Lever").json()
    assert described["methods"]["lift"]["output"] == "force"
    page = httpx.get(f"{server.url}/services/lab/Levre", headers={"Accept": "text/html"})
    assert page.status_code == 404
    assert "did you mean" in page.text
