"""An address that is none is refused before anything is sent, whoever is to use it."""

from __future__ import annotations

import pytest

import rtask
from rtask.errors import AuthenticationError, UsageError

_WRONG = [
    "http://",
    "http://[::1",
    "http://localhost:99999",
    "http://localhost:876s",
    "http://a b/",
    "http://ex\x00ample/",
]


@pytest.mark.parametrize("address", _WRONG)
def test_an_address_that_is_none_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match="is not the address of a server; expected http://host"):
        rtask.connect(address)
    for plain in (True, False):
        with pytest.raises(UsageError, match="is not the address of a server"):
            rtask.open(address, plain=plain)
    with pytest.raises(UsageError, match="is not the address of a server"):
        rtask.open(f"sparql+{address}")


@pytest.mark.parametrize("token", ["secret\n", "two words", "gehe\u00efm"])
def test_a_token_that_is_none_is_refused_in_words(token: str) -> None:
    with rtask.connect("http://127.0.0.1:9", token=token, timeout_s=1) as client:
        with pytest.raises(AuthenticationError, match="has a character that no token has"):
            client.query("ASK {}")
        with pytest.raises(AuthenticationError, match="has a character that no token has"):
            client.call("search_object", name="cup")
    with pytest.raises(AuthenticationError, match="has a character that no token has"):
        rtask.open("http://127.0.0.1:9", token=token)
