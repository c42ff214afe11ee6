"""Below SPARQL: headers, lengths, floods, cuts, TLS, the end of a server."""

from __future__ import annotations

import gzip
import json
import signal
import socket
import ssl
import subprocess
import time
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

import rtask
from tests.commands import run_command
from tests.servers import RunningServer, ServerDidNotStartError, running_server

pytestmark = pytest.mark.slow

HOST = "Host: 127.0.0.1\r\n"


@pytest.fixture(scope="module")
def target(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("hostile") / "store"
    with running_server(folder, "--profile", "plain", "--max-upload", "4") as running:
        yield running


def say(server: RunningServer, data: bytes, *, shut: bool = False) -> bytes:
    """Send bytes and return what comes back until the server closes or says nothing."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as connection:
        connection.sendall(data)
        if shut:
            connection.shutdown(socket.SHUT_WR)
        answer = b""
        try:
            while piece := connection.recv(65536):
                answer += piece
                if b"\r\n\r\n" in answer and not shut:
                    break
        except (TimeoutError, ConnectionResetError):
            pass
        return answer


def alive(server: RunningServer) -> bool:
    return httpx.get(f"{server.url}/health/live").status_code == 200


POST = f"POST /query HTTP/1.1\r\n{HOST}"
NO_REQUESTS = {
    "long header": (f"GET / HTTP/1.1\r\n{HOST}X: {'a' * 100_000}\r\n\r\n", 431),
    "long address": (f"GET /?{'a' * 40_000} HTTP/1.1\r\n{HOST}\r\n", 414),
    "two kinds of length": (f"{POST}Content-Length: 3\r\nTransfer-Encoding: chunked\r\n\r\n", 400),
    "two hosts": (f"GET /health/live HTTP/1.1\r\n{HOST}Host: evil.example\r\n\r\n", 400),
    "the same host twice": (f"GET /health/live HTTP/1.1\r\n{HOST}{HOST}\r\n", 400),
    "no host": ("GET /health/live HTTP/1.1\r\nAccept: */*\r\n\r\n", 400),
    "a host that is none": ("GET /health/live HTTP/1.1\r\nHost: a b/c\r\n\r\n", 400),
    "two lengths": (f"{POST}Content-Length: 3\r\nContent-Length: 4\r\n\r\nabc", 400),
    "negative length": (f"{POST}Content-Length: -1\r\n\r\n", 400),
    "space in a name": (f"GET / HTTP/1.1\r\n{HOST}X : 1\r\n\r\n", 400),
    "tls": ("\x16\x03\x01\x02\x00\x01\x00", 400),
    "many fields": (f"GET /query?{'a=1&' * 3_000} HTTP/1.1\r\n{HOST}\r\n", 400),
}


@pytest.mark.parametrize(("head", "status"), NO_REQUESTS.values(), ids=NO_REQUESTS.keys())
def test_what_is_no_request_is_refused_and_the_connection_ends(
    target: RunningServer, head: str, status: int
) -> None:
    answer = say(target, head.encode("latin-1"))
    assert answer.startswith(f"HTTP/1.1 {status} ".encode()), answer[:200]
    assert b"Traceback" not in answer
    assert alive(target)


def test_before_http_1_1_no_host_is_needed(target: RunningServer) -> None:
    assert b" 200 " in say(target, b"GET /health/live HTTP/1.0\r\n\r\n").partition(b"\r\n")[0]


def test_half_a_body_changes_nothing(target: RunningServer) -> None:
    body = "INSERT DATA { <urn:half> <urn:p> 1 } ; # and more"
    head = (
        f"POST /update HTTP/1.1\r\n{HOST}Content-Type: application/sparql-update\r\n"
        f"Content-Length: {len(body) + 100}\r\n\r\n{body}"
    )
    say(target, head.encode(), shut=True)
    chunked = (
        f"POST /update HTTP/1.1\r\n{HOST}Content-Type: application/sparql-update\r\n"
        f"Transfer-Encoding: chunked\r\n\r\n{len(body):x}\r\n{body}\r\n"
    )
    say(target, chunked.encode(), shut=True)
    found = httpx.get(f"{target.url}/query", params={"query": "ASK { <urn:half> ?p ?o }"})
    assert found.json()["boolean"] is False


def test_a_body_beyond_the_limit_is_413_packed_or_not(target: RunningServer) -> None:
    headers = {"Content-Type": "text/turtle"}
    url = f"{target.url}/store?graph=urn:bomb"
    plain = httpx.put(url, content=b"#" * (5 << 20), headers=headers)
    assert plain.status_code == 413
    packer = zlib.compressobj(9, wbits=31)
    bomb = b"".join(packer.compress(b"#" * (1 << 20)) for _ in range(256)) + packer.flush()
    packed = httpx.put(url, content=bomb, headers={**headers, "Content-Encoding": "gzip"})
    assert packed.status_code == 413
    assert httpx.head(url).status_code == 404


def test_a_body_that_announces_too_much_is_413_before_it_comes(target: RunningServer) -> None:
    for length in (5 << 20, 10**10, int("9" * 18)):
        head = (
            f"POST /update HTTP/1.1\r\n{HOST}Content-Type: application/sparql-update\r\n"
            f"Content-Length: {length}\r\n\r\nINSERT"
        )
        assert say(target, head.encode()).startswith(b"HTTP/1.1 413 ")


def test_a_packed_body_is_read(target: RunningServer) -> None:
    headers = {"Content-Type": "text/turtle", "Content-Encoding": "gzip"}
    url = f"{target.url}/store?graph=urn:packed"
    body = gzip.compress(b"<a:a> <a:b> 1 .")
    assert httpx.put(url, content=body, headers=headers).status_code == 201


def test_many_half_headers_keep_nobody_out(target: RunningServer) -> None:
    waiting = []
    try:
        for _ in range(300):
            connection = socket.create_connection(("127.0.0.1", target.port), timeout=60)
            connection.sendall(b"GET / HTTP/1.1\r\nHost: 127")
            waiting.append(connection)
        assert alive(target)
        answer = httpx.get(f"{target.url}/query", params={"query": "ASK {}"})
        assert answer.status_code == 200
    finally:
        for connection in waiting:
            connection.close()


def test_a_flood_of_one_token_is_answered_429_and_another_is_served(tmp_path: Path) -> None:
    folder = tmp_path / "store"

    def token() -> str:
        command = ("token", "create", "--data", str(folder), "--role", "reader", "--json")
        done = run_command(*command, check=True)
        return f"Bearer {json.loads(done.stdout)['token']}"

    hasty, calm = token(), token()
    with (
        running_server(folder, "--profile", "full", "--rate", "1") as server,
        ThreadPoolExecutor(8) as flood,
        httpx.Client(timeout=60) as client,
    ):
        url = f"{server.url}/query?query=ASK%7B%7D"
        # Sixty at one a second: only a machine that needs a minute for them would let all pass.
        found = list(
            flood.map(lambda _: client.get(url, headers={"Authorization": hasty}), range(60))
        )
        statuses = {answer.status_code for answer in found}
        assert statuses == {200, 429}
        refused = next(answer for answer in found if answer.status_code == 429)
        assert int(refused.headers["retry-after"]) >= 1
        assert refused.json()["type"] == "/errors/too-many-requests"
        assert client.get(url, headers={"Authorization": calm}).status_code == 200


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("tls")
    cert, key = folder / "cert.pem", folder / "key.pem"
    try:
        subprocess.run(
            [
                *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"),
                *("-keyout", str(key), "-out", str(cert), "-subj", "/CN=localhost"),
                *("-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"),
            ],
            check=True,
            capture_output=True,
            timeout=60,
        )
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no openssl to make a certificate with")
    return cert, key


def test_https_by_certificate_files(certificate: tuple[Path, Path]) -> None:
    cert, key = certificate
    with running_server(None, "--tls-cert", str(cert), "--tls-key", str(key)) as server:
        assert server.url.startswith("https://")
        context = ssl.create_default_context(cafile=str(cert))
        with httpx.Client(verify=context, base_url=server.url) as client:
            assert client.get("/query?query=ASK%7B%7D").json()["boolean"] is True
            server.process.send_signal(signal.SIGHUP)  # reads the files again
            time.sleep(0.2)
        with httpx.Client(verify=context, base_url=server.url) as client:
            assert client.get("/health/live").status_code == 200


def test_a_certificate_without_its_key_is_refused(certificate: tuple[Path, Path]) -> None:
    with (
        pytest.raises(ServerDidNotStartError, match="both --tls-cert and --tls-key"),
        running_server(None, "--tls-cert", str(certificate[0])),
    ):
        pass


def test_behind_a_proxy_this_machine_has_no_privileges(tmp_path: Path) -> None:
    with (
        pytest.raises(ServerDidNotStartError, match="no token exists"),
        running_server(tmp_path / "store", "--behind-proxy"),
    ):
        pass


def test_the_end_is_announced_before_it_comes(tmp_path: Path) -> None:
    with running_server(None, "--drain-delay", "60") as server:
        assert httpx.get(f"{server.url}/health/ready").status_code == 200
        server.process.send_signal(signal.SIGTERM)
        deadline = time.monotonic() + 60
        while (answer := httpx.get(f"{server.url}/health/ready")).status_code == 200:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        assert "draining" in answer.json()["failing"]
        assert httpx.get(f"{server.url}/query?query=ASK%7B%7D").status_code == 200
        server.process.send_signal(signal.SIGTERM)  # the second one ends it without the delay
        assert server.process.wait(60) == 0


def test_a_backup_made_while_serving_opens_and_has_what_was_acknowledged(tmp_path: Path) -> None:
    with running_server(tmp_path / "store") as server:
        insert = {"update": "INSERT DATA { GRAPH <urn:g> { <urn:kept> <urn:p> 1 } }"}
        assert httpx.post(f"{server.url}/update", data=insert).status_code == 204
        foreign = {"Origin": "https://evil.example"}
        assert httpx.post(f"{server.url}/backup", headers=foreign).status_code == 403
        answer = httpx.post(f"{server.url}/backup", timeout=60)
        assert answer.status_code == 201, answer.text
        assert httpx.post(f"{server.url}/update", data=insert).status_code == 204
    copy = Path(answer.json()["folder"])
    assert copy.parent == tmp_path / "store-backups"
    with rtask.open(copy, mode="r") as kb:
        assert kb.seq == answer.json()["seq"]
        assert kb.query("ASK { <urn:kept> <urn:p> 1 }") is True
