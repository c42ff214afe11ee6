"""The distribution rtask-ros2: what it holds and imports, and that Python 3.10 can read it."""

from __future__ import annotations

import ast
import json
import os
import shutil
import stat
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner

from rtask.cli import cli
from rtask.cli.ros.schema import engine_schema
from rtask.cli.ros2.package import DEPENDENCIES, PROVIDED, write_package
from rtask.client.base import RULES
from rtask.errors import UsageError
from rtask.ros2.contract import Contract
from tests.architecture.imports import ROOT, import_statements

# Names that Python 3.10 lacks, of modules that the node imports.
NEWER = {
    "typing": {"Self", "Required", "NotRequired", "LiteralString", "assert_never", "Unpack"},
    "datetime": {"UTC"},
    "enum": {"StrEnum", "verify", "member"},
    "contextlib": {"chdir"},
    "math": {"cbrt", "exp2"},
    "hashlib": {"file_digest"},
    "asyncio": {"TaskGroup", "Runner", "timeout"},
    "itertools": {"batched"},
}


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    return write_package(tmp_path_factory.mktemp("ros2"))


@pytest.fixture(scope="module")
def modules(package):
    return {file: file.read_text("utf-8") for file in sorted(package.rglob("*.py"))}


def test_python_3_10_can_read_every_module(modules):
    for file, text in modules.items():
        ast.parse(text, str(file), feature_version=(3, 10))


IMPORT_ALL = """
import importlib, pathlib, sys
sys.path.insert(0, sys.argv[1])
lacking = {}
for file in sorted(pathlib.Path(sys.argv[1], "rtask_ros2").rglob("*.py")):
    name = ".".join(file.relative_to(sys.argv[1]).with_suffix("").parts)
    try:
        importlib.import_module(name.removesuffix(".__init__"))
    except ModuleNotFoundError as error:
        lacking[name] = error.name.partition(".")[0]
print(sys.version_info[:2], sorted(set(lacking.values())), len(lacking))
"""


def python_3_10() -> str | None:
    """Return an interpreter of Python 3.10 that starts, or None."""
    installed = sorted(Path.home().glob(".pyenv/versions/3.10.*/bin/python3.10"))
    for name in (shutil.which("python3.10"), *map(str, installed)):
        if (
            name
            and subprocess.run([name, "-c", ""], capture_output=True, check=False).returncode == 0
        ):
            return name
    return None


def test_python_3_10_itself_imports_every_module_whose_libraries_it_has(package):
    interpreter = python_3_10()
    if interpreter is None:
        pytest.skip("no Python 3.10 here")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    run = subprocess.run(
        [interpreter, "-B", "-c", IMPORT_ALL, str(package)], env=environment, check=False,
        capture_output=True, text=True, timeout=100,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    version, _, rest = run.stdout.partition(") ")
    names, _, count = rest.rpartition(" ")
    assert version == "(3, 10"
    assert set(ast.literal_eval(names)) <= {"numpy", "websockets"}
    assert int(count) < len(list(package.rglob("*.py"))) / 2


def test_it_imports_the_standard_library_its_dependencies_and_ros_only(modules):
    own = {name.partition(">")[0] for name in DEPENDENCIES} | set(PROVIDED) | {"rtask_ros2"}
    allowed = own | sys.stdlib_module_names | {"setuptools"}
    for file, text in modules.items():
        for node in import_statements(ast.parse(text)):
            names = (
                [alias.name for alias in node.names]
                if isinstance(node, ast.Import)
                else [node.module or ""]
            )
            foreign = {name.partition(".")[0] for name in names} - allowed
            # One name for annotations only; nothing imports it at run time.
            assert foreign <= ({"httpx"} if file.name == "failures.py" else set()), file


def test_it_uses_no_name_of_the_library_that_python_3_10_lacks(modules):
    for file, text in modules.items():
        tree = ast.parse(text)
        for node in import_statements(tree):
            if isinstance(node, ast.ImportFrom):
                lacking = NEWER.get(node.module or "", set())
                assert lacking.isdisjoint(alias.name for alias in node.names), file
        handlers = [node for node in ast.walk(tree) if isinstance(node, ast.TryStar)]
        assert not handlers, file


def test_every_import_within_it_leads_to_a_module_of_it(package, modules):
    for file, text in modules.items():
        for node in import_statements(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rtask_ros2"):
                path = package.joinpath(*node.module.split("."))
                assert path.with_suffix(".py").is_file() or path.is_dir(), (file, node.module)


def test_the_contract_goes_with_it_as_data(package):
    read = Contract.read(package / "rtask_ros2/ros2/contract.json")
    assert read == Contract(engine_schema(), RULES)


def test_it_declares_what_it_needs_and_where_ros2_run_looks(package):
    manifest = (package / "package.xml").read_text()
    assert "<build_type>ament_python</build_type>" in manifest
    assert "<exec_depend>rtask_msgs</exec_depend>" in manifest
    assert (package / "resource/rtask_ros2").is_file()
    assert (package / "scripts/node").stat().st_mode & stat.S_IXUSR
    setup = (package / "setup.py").read_text()
    assert '("lib/rtask_ros2", ["scripts/node"])' in setup
    assert "websockets>=15" in setup
    base = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert {name.partition(">")[0] for name in DEPENDENCIES} <= {n.partition(">")[0] for n in base}


@pytest.mark.slow
def test_its_wheel_is_pure_and_imports_without_rtask(package, tmp_path):
    pytest.importorskip("setuptools")
    # Of the tree of sources nothing may be left to import.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    subprocess.run(
        [sys.executable, "setup.py", "-q", "egg_info", "--egg-base", str(tmp_path), "build",
         "--build-base", str(tmp_path / "b"), "install_lib", "--install-dir",
         str(tmp_path / "lib")],
        cwd=package, env=environment, check=True, capture_output=True, timeout=100,
    )  # fmt: skip
    archive = tmp_path / "lib.zip"
    with zipfile.ZipFile(archive, "w") as zipped:
        for file in sorted((tmp_path / "lib").rglob("*.py")):
            zipped.write(file, file.relative_to(tmp_path / "lib"))
    program = (
        f"import sys; sys.path.insert(0, {str(archive)!r})\n"
        "import rtask_ros2.ros2.main, rtask_ros2.client.calling.client\n"
        "print(sorted(n for n in sys.modules if n.split('.')[0] in ('rtask', 'pydantic', 'rclpy')))"
    )
    run = subprocess.run(
        [sys.executable, "-I", "-c", program], cwd=tmp_path, env=environment,
        capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    assert (run.returncode, run.stdout.strip()) == (0, "[]"), run.stderr


def test_another_folder_of_that_name_is_not_replaced(tmp_path):
    (tmp_path / "rtask_ros2").mkdir()
    with pytest.raises(UsageError, match="is no package rtask_ros2"):
        write_package(tmp_path)


def test_the_command_writes_the_package(tmp_path):
    run = CliRunner().invoke(cli, ["ros2", "package", str(tmp_path), "--json"])
    assert run.exit_code == 0, run.output
    written = json.loads(run.stdout)
    assert written["package"] == str(tmp_path / "rtask_ros2")
    assert "rtask.ros2.main" in written["modules"]
    contract = json.loads((tmp_path / "rtask_ros2/rtask_ros2/ros2/contract.json").read_text())
    assert "where_is" in contract["rules"]["repeatable"]


def test_without_ros_2_the_node_says_what_to_source():
    run = subprocess.run(
        [sys.executable, "-m", "rtask", "ros2", "node"],
        capture_output=True, text=True, check=False, timeout=100,
    )  # fmt: skip
    if "no rclpy" not in run.stderr:
        pytest.skip("this Python has rclpy")
    assert run.returncode == 2
    assert "source a ROS 2" in run.stderr
