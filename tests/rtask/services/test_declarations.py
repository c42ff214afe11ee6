"""Declarations of services: versions, types, names; and where services are loaded from."""

from __future__ import annotations

import threading
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from rtask.errors import (
    UnknownTermError,
    UsageError,
)
from rtask.services import (
    Call,
    Service,
    ServiceHost,
    data_resource,
    method,
)
from rtask.services.definition import define
from rtask.services.registry import GROUP, installed, load
from tests.rtask.services.lab import (
    Arm,
)


@pytest.mark.parametrize(
    ("wanted", "version"),
    [("", "1.2.0"), ("@1.*", "1.2.0"), ("@1.1.*", "1.1.9"), ("@1.1.9", "1.1.9")],
)
def test_a_version_is_exact_or_the_newest_that_fits(host, wanted, version):
    assert host.registry.find(f"lab/Arm{wanted}").version == version


def test_a_version_that_is_not_there_names_those_that_are(host):
    with pytest.raises(UnknownTermError, match=r"no version 2.\*; there are 1.2.0, 1.1"):
        host.call("lab/Arm@2.*", "forward")
    with pytest.raises(UsageError, match=r"expected 1.2.3"):
        host.call("lab/Arm@newest", "forward")
    with pytest.raises(UsageError, match=r"expected 1.2.3"):
        host.call(f"lab/Arm@{'9' * 5000}", "forward")


def test_a_version_that_is_taken_is_refused():
    class Other(Service):
        """Another arm."""

        name, version = "lab/Arm", "1.2.0"

        @method
        def forward(self) -> None:
            """Nothing."""

    with pytest.raises(UsageError, match=r"lab/Arm@1.2.0 is there already"):
        ServiceHost([Arm, Other])


class NoAnnotation(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, speed) -> None:
        """Go."""


class Unsendable(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, lock: threading.Event) -> None:
        """Go."""


class NoResult(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method(effect="reads")
    def go(self, call: Call):
        """Go."""


class BadName(Service):
    """A mistake."""

    name = "Wrong"

    @method
    def go(self) -> None:
        """Go."""


class Idle(Service):
    """A mistake."""

    name = "lab/Wrong"


class TwoKinds(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, speed: int | str) -> None:
        """Go."""


class TakenName(Service):
    """A mistake."""

    name = "lab/Wrong"

    @method
    def go(self, copy: int) -> None:
        """Go."""


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            NoAnnotation,
            r"test_declarations.py:\d+: NoAnnotation.go: parameter 'speed' has no annot",
        ),
        (Unsendable, r"Unsendable.go: lock: .*Event.* cannot be sent"),
        (TwoKinds, r"TwoKinds.go: speed: int \| str cannot be sent"),
        (NoResult, "NoResult.go: the result has no annotation"),
        (BadName, "expected <namespace>/<name>"),
        (Idle, "Idle has no method"),
        (TakenName, "a parameter cannot be called 'copy'"),
    ],
)
def test_a_mistake_in_a_declaration_names_file_line_and_parameter(wrong, words):
    with pytest.raises(UsageError, match=words):
        define(wrong)


def test_a_data_resource_is_of_a_known_type():
    with pytest.raises(UsageError, match="unknown type 'sql'"):
        data_resource("sql")  # type: ignore[arg-type]  # the mistake


def test_services_are_loaded_from_a_file_and_from_a_module(tmp_path: Path):
    assert {one.name for one in load("tests.rtask.services.lab")} >= {"lab/Arm", "lab/Reader"}
    file = tmp_path / "mine.py"
    file.write_text(
        "from rtask.services import Service, method\n"
        "class Half(Service):\n"
        "    '''Halves.'''\n"
        "    name = 'lab/Half'\n"
        "    @method\n"
        "    def of(self, number: float) -> float:\n"
        "        '''Half of a number.'''\n"
        "        return number / 2\n",
        "utf-8",
    )
    with ServiceHost(load(str(file))) as host:
        assert host.call("lab/Half", "of", {"number": 3}).as_json() == {"result": 1.5}
    with pytest.raises(UsageError, match="no file"):
        load(str(tmp_path / "none.py"))
    with pytest.raises(UsageError, match="defines no service"):
        load("tests.rtask.services")
    with pytest.raises(UsageError, match="no module no_such"):
        load("no_such")


def test_a_package_whose_services_cannot_be_loaded_is_left_out(monkeypatch, tmp_path, caplog):
    (tmp_path / "broken_services.py").write_text("undefined_name\n")
    monkeypatch.syspath_prepend(tmp_path)
    entries = [EntryPoint(n, n, GROUP) for n in ("broken_services", "tests.rtask.services.lab")]
    monkeypatch.setattr("rtask.services.registry._entries", lambda: entries)
    assert [one.__name__ for one in installed()] == ["tests.rtask.services.lab"]
    assert "services of broken_services cannot be loaded" in caplog.text


def test_a_description_states_the_declared_effect_of_each_method(host):
    methods = host.description("lab/Arm")["methods"]
    effects = {name: methods[name]["effect"] for name in ("forward", "count", "store", "ask_again")}
    assert effects == {
        "forward": "reads", "count": "reads", "store": "writes", "ask_again": "writes",
    }  # fmt: skip
    assert all(one["only_reads"] == (one["effect"] == "reads") for one in methods.values())


def test_a_method_that_could_write_must_say_whether_it_does():
    class Silent(Service):
        """A mistake."""

        name = "lab/Silent"

        @method(scope="write")
        def go(self) -> None:
            """Go."""

    with pytest.raises(UsageError, match="it could write; say what it does"):
        define(Silent)


def test_a_method_that_reads_cannot_call_one_that_writes():
    class Sly(Service):
        """A method that says less than it does."""

        name = "lab/Sly"

        @method(effect="reads")
        def go(self, call: Call) -> str:
            """Go."""
            return str(call.connect("lab/Arm").store("cup"))

    with (
        ServiceHost([Sly, Arm]) as host,
        pytest.raises(UsageError, match="declares effect='reads'"),
    ):
        host.call("lab/Sly", "go")
