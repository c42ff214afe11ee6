"""The host that most tests of services share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from rtask.services import (
    ServiceHost,
)
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
