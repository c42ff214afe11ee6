"""nginx with the configuration of docs/deploy, before servers of this machine."""

from __future__ import annotations

import contextlib
import re
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import httpx

NGINX = shutil.which("nginx", path="/usr/sbin:/usr/bin:/usr/local/sbin")
_CONF = Path(__file__).resolve().parents[1] / "docs" / "deploy" / "nginx.conf"


@contextlib.contextmanager
def running_nginx(
    folder: Path, port: int, servers: Sequence[int], tls_port: int | None = None
) -> Iterator[None]:
    """Run nginx for the duration of the block.

    Parameters
    ----------
    folder
        Where its files go. ``rtask.pem`` is the certificate, if it serves HTTPS.
    port
        Where it listens.
    servers
        Ports of the writer and of its two followers.
    tls_port
        Where it also listens as its comment about TLS says; none = nowhere.
    """
    assert NGINX is not None
    text = _CONF.read_text("utf-8")
    server = text[text.index("server {") :]
    text = text.replace("listen 8080", f"listen 127.0.0.1:{port}")
    if tls_port is not None:
        text += _with_tls(server, tls_port, folder)
    for published, own in zip((8765, 8766, 8767), servers, strict=True):
        text = text.replace(f"127.0.0.1:{published}", f"127.0.0.1:{own}")
    head = f"daemon off; pid {folder}/pid; error_log {folder}/error.log; events {{}}\n"
    paths = "".join(
        f"{name}_temp_path {folder}/{name};\n"
        for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    )
    (folder / "nginx.conf").write_text(f"{head}http {{ access_log off;\n{paths}{text}\n}}\n")
    command = [NGINX, "-c", str(folder / "nginx.conf"), "-e", str(folder / "error.log")]
    with subprocess.Popen(command) as nginx:
        try:
            end = time.monotonic() + 60
            while not _listens(port):
                assert nginx.poll() is None, (folder / "error.log").read_text("utf-8")
                assert time.monotonic() < end
                time.sleep(0.05)
            yield
        finally:
            nginx.terminate()


def _listens(port: int) -> bool:
    try:
        httpx.get(f"http://127.0.0.1:{port}/health/live")
    except httpx.TransportError:
        return False
    return True


def _with_tls(server: str, port: int, folder: Path) -> str:
    """Return a server of nginx as its comment about TLS says, with a certificate of its own."""
    key, cert = folder / "rtask.key", folder / "rtask.pem"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"),
            *("-keyout", str(key), "-out", str(cert), "-subj", "/CN=localhost"),
            *("-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"),
        ],
        check=True,
        capture_output=True,
    )
    without_plain = re.sub(r"\n    listen 8080;", "", server)
    uncommented = re.sub(r"(?m)^    # (?=listen|ssl_)", "    ", without_plain)
    return (
        uncommented.replace("listen 443", f"listen 127.0.0.1:{port}")
        .replace("/etc/ssl/rtask.pem", str(cert))
        .replace("/etc/ssl/rtask.key", str(key))
    )
