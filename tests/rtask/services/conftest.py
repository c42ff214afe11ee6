"""Fixtures that tests of services share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from rtask.services import (
    ServiceHost,
)
from rtask.services.datasets.store import Datasets
from rtask.services.pool import Pool
from rtask.services.task import Task
from tests.rtask.services.endings.moments import Gate
from tests.rtask.services.lab import (
    Arm,
    Broken,
    Detour,
    OldArm,
    Reader,
)


@pytest.fixture
def host() -> Iterator[ServiceHost]:
    with ServiceHost([OldArm, Arm, Detour, Broken, Reader], check_every=1) as opened:
        yield opened


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Gate:
    """Stop calls also at the moments that lie in the server."""
    made = Gate(tmp_path)

    def before(owner: type, name: str, moment: str, after: str = "") -> None:
        original = getattr(owner, name)

        def stopping(*args, **kwargs):
            made.reach(moment)
            found = original(*args, **kwargs)
            made.reach(after)
            return found

        monkeypatch.setattr(owner, name, stopping)

    before(Pool, "_carry_out", "given to a worker")
    before(Task, "succeed", "returned")
    before(Datasets, "put_together", "being stored", "stored")
    return made
