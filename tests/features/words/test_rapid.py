"""The reader of the extra ``words``: it reads, and never asks the network for anything."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        importlib.util.find_spec("rapidocr") is None, reason="the extra 'words' is not installed"
    ),
]

_WITHOUT_NETWORK = """
import socket
def refused(*arguments, **options):
    raise AssertionError("the network was asked")
for name in ("connect", "connect_ex", "sendto"):
    setattr(socket.socket, name, refused)
socket.getaddrinfo = socket.create_connection = refused
import cv2, numpy as np
from features.words.rapid import RapidReader
from features.words.word import words_of_view
image = np.full((200, 420, 3), 230, np.uint8)
cv2.putText(image, "VANILJ", (60, 120), cv2.FONT_HERSHEY_DUPLEX, 2.2, (20, 30, 90), 4, cv2.LINE_AA)
reader = RapidReader()
for picture in (image, np.ascontiguousarray(image[::-1, ::-1]), np.full((40, 60, 3), 90, np.uint8)):
    for word in words_of_view(reader, picture, np.ones(picture.shape[:2], bool)):
        print(word.text, round(word.score, 1), *(round(value) for value in word.centre))
print(reader.name)
"""


def test_print_is_read_without_network():
    done = subprocess.run(
        [sys.executable, "-c", _WITHOUT_NETWORK], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    *lines, name = done.stdout.splitlines()
    assert [line.split()[0] for line in lines] == ["VANILJ", "VANILJ"]  # upside down, too
    assert name.startswith("rapidocr 3.")
    for line in lines:
        _, score, u, v = line.split()
        assert float(score) > 0.9
        assert abs(float(u) - 210) < 60
        assert abs(float(v) - 100) < 30


def test_a_network_that_is_missing_is_an_error_and_not_fetched(tmp_path, monkeypatch):
    import rapidocr

    from features.words.rapid import RapidReader

    monkeypatch.setattr(rapidocr, "__file__", str(tmp_path / "__init__.py"))
    with pytest.raises(ValueError, match=r"lacks PP-OCRv6_det_small\.onnx"):
        RapidReader()
