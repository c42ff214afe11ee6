"""Folders of datasets that nobody uses are removed, those in use and the latest are kept."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest

from rtask.services import Service, ServiceHost, data_resource, method
from rtask.services.datasets.store import Datasets
from rtask.services.datasets.views import Views

HOUR_S = 3600.0


class User:
    """Somebody who reads a view."""


def made(views: Views, name: str, age_s: float = 0.0) -> Path:
    place = views.get(name, lambda folder: (folder / "file").write_text(name) and None)
    used = place.stat().st_mtime - age_s
    os.utime(place, (used, used))
    return place


def names(folder: Path) -> list[str]:
    return sorted(one.name for one in folder.iterdir() if one.is_dir())


def test_the_views_longest_out_of_use_go_when_there_are_many(tmp_path: Path):
    views = Views(tmp_path / "views")
    for age, name in enumerate(["d", "c", "b", "a"]):
        made(views, name, (2 + age) * HOUR_S)
    Views(tmp_path / "views", most=2).prune()
    assert names(tmp_path / "views") == ["c", "d"]
    assert views.get("a", lambda folder: (folder / "file").write_text("again") and None).exists()


def test_a_view_that_was_asked_for_lately_stays(tmp_path: Path):
    views = Views(tmp_path / "views", most=1)
    for name in "abc":
        made(views, name)
    views.prune()
    assert names(tmp_path / "views") == ["a", "b", "c"]


def test_a_view_stays_as_long_as_its_user_lives(tmp_path: Path):
    views, others = Views(tmp_path / "views", most=0), Views(tmp_path / "views", most=0)
    user = User()
    views.keep(made(views, "a", 2 * HOUR_S), user)
    made(views, "b", 2 * HOUR_S)
    others.prune()  # as another process that shares the folder would
    assert names(tmp_path / "views") == ["a"]
    del user
    gc.collect()
    others.prune()
    assert names(tmp_path / "views") == []


def test_a_view_that_is_gone_is_made_again(tmp_path: Path):
    views = Views(tmp_path / "views", most=0)
    for _ in range(3):
        assert (made(views, "a", 2 * HOUR_S) / "file").read_text() == "a"
        views.prune()
        assert list(tmp_path.glob("views/a*")) == []


def test_what_a_killed_process_left_half_made_goes(tmp_path: Path):
    views = Views(tmp_path / "views")
    made(views, "a")
    left = tmp_path / "views" / "making-xyz"
    left.mkdir()
    os.utime(left, (1.0, 1.0))
    views.prune()
    assert names(tmp_path / "views") == ["a"]


def test_a_view_that_cannot_be_filled_leaves_nothing(tmp_path: Path):
    views = Views(tmp_path / "views")

    def fill(folder: Path) -> None:
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        views.get("a", fill)
    assert names(tmp_path / "views") == []


class Reader(Service):
    """Reads its data when asked."""

    name = "lab/Reader"
    data = data_resource("binary")

    @method
    def read(self) -> str:
        """Read."""
        return self.data.path("/text").read_text()


def test_a_service_reads_its_data_however_many_views_came_later(tmp_path: Path):
    datasets = Datasets(tmp_path / "datasets")
    with ServiceHost([Reader], datasets=datasets) as host:
        datasets.create("lab/Text")
        datasets.put("lab/Text", {"text": b"first"})
        first = datasets.snapshot("lab/Text").name
        assert host.call("lab/Reader", "read", data={"data": first})["result"] == "first"
        views = tmp_path / "datasets" / "views"
        for place in views.iterdir():
            os.utime(place, (1.0, 1.0))
        other = Views(views, most=0)
        other.prune()
        assert host.call("lab/Reader", "read", data={"data": first})["result"] == "first"
