"""Fixtures of the tests of perception."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def compiled_kernels() -> None:
    """Compile the kernels of segmentation and recognition: half a minute or more, once a machine.

    Tests that are about something else ask for it, so that it is no part of the time they take.
    """
    from features.recognition import warm_up as warm_up_recognition
    from features.segmentation.scene import warm_up as warm_up_segmentation

    warm_up_segmentation()
    warm_up_recognition()
