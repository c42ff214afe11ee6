"""A page on which the audience picks the weak end of the carton and watches the proof.

The page is served on this machine alone, by the program that runs the proof. It shows each line as
it is said, the tables as they come about, and the report when all is done.
"""

from __future__ import annotations

import html
import json
import threading
from collections.abc import Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Literal
from urllib.parse import parse_qs, unquote, urlsplit

from simulate.demo.console import Console, event_sentence

__all__ = ["Stage", "StageConsole"]

End = Literal["left", "right"]

_HERE = Path(__file__).parent
_ENDS: tuple[End, ...] = ("left", "right")
_TYPES = {".html": "text/html; charset=utf-8", ".jpg": "image/jpeg", ".png": "image/png",
          ".json": "application/json"}  # fmt: skip
_MAX_FORM = 1000
_MISSING = 404
_POLICY = (
    "default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'; "
    "script-src 'unsafe-inline'; connect-src 'self'; frame-src 'self'; form-action 'self'"
)


class Stage:
    """Serves the page until it is closed.

    Parameters
    ----------
    report
        Folder that will have ``proof.html``.
    port
        0 = any that is free.
    """

    def __init__(self, report: Path, port: int = 0) -> None:
        self._report = report
        self._lock = threading.Lock()
        self._picked = threading.Event()
        self._weak: End | None = None
        self._lines: list[str] = []
        self._is_over = False
        handler = type("Handler", (_Handler,), {"stage": self})
        self._server = ThreadingHTTPServer(("127.0.0.1", port), handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/"
        """Address of the page."""
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        """End the page."""
        self._server.shutdown()
        self._server.server_close()

    def wait(self, timeout_s: float | None = None) -> End | None:
        """Wait for the audience to pick; return the end, None if nobody did in time."""
        self._picked.wait(timeout_s)
        return self._weak

    def pick(self, end: End) -> bool:
        """Pick the weak end; return whether it was the first pick, which alone counts."""
        with self._lock:
            is_first = self._weak is None
            if is_first:
                self._weak = end
        self._picked.set()
        return is_first

    def say(self, line: str) -> None:
        """Show a line of HTML under those before it."""
        with self._lock:
            self._lines.append(line)

    def finish(self) -> None:
        """Show the report, which lies in its folder by now."""
        with self._lock:
            self._is_over = True

    def state(self) -> dict[str, Any]:
        """Return what the page shows, as JSON data."""
        with self._lock:
            return {"weak": self._weak, "lines": list(self._lines), "over": self._is_over}

    def page(self) -> str:
        """Return the page as it is now; without scripts, it is to be loaded again."""
        style = (_HERE / "report.css").read_text("utf-8")
        page, state = (_HERE / "proof_stage.html").read_text("utf-8"), self.state()
        # No text of a line can end the script.
        script = json.dumps(state).replace("<", "\\u003c")
        for mark, text in (
            ("/* style */", style),
            ("{picked}", " hidden" if state["weak"] else ""),
            ("{count}", str(len(state["lines"]))),
            ("{state}", script),
            ("{lines}", "".join(state["lines"])),  # last: what they say is no mark
        ):
            page = page.replace(mark, text)
        return page

    def file(self, name: str) -> bytes | None:
        """Return a file of the report's folder; None if there is none."""
        folder = self._report.resolve()
        path = (folder / name).resolve()
        if not path.is_relative_to(folder) or not path.is_file() or path.suffix not in _TYPES:
            return None
        return path.read_bytes()


class _Handler(BaseHTTPRequestHandler):
    """Answers the browser."""

    stage: Stage

    def do_GET(self) -> None:
        path = unquote(urlsplit(self.path).path)
        if not self._is_ours():
            return
        if path == "/":
            self._answer(self.stage.page().encode(), _TYPES[".html"])
        elif path == "/state":
            self._answer(json.dumps(self.stage.state()).encode(), _TYPES[".json"])
        elif path.startswith("/report/"):
            content = self.stage.file(path.removeprefix("/report/"))
            if content is None:
                self.send_error(_MISSING)
            else:
                self._answer(content, _TYPES[Path(path).suffix])
        else:
            self.send_error(_MISSING)

    def do_POST(self) -> None:
        length = int(self.headers.get("Content-Length") or 0)
        if not self._is_ours():
            return
        if self.path != "/weak" or not 0 < length <= _MAX_FORM:
            self.send_error(_MISSING)
            return
        (picked,) = parse_qs(self.rfile.read(length).decode("latin-1")).get("end", [""])[:1]
        end = next((end for end in _ENDS if end == picked), None)
        if end is None:
            self.send_error(HTTPStatus.BAD_REQUEST, "end is left or right")
            return
        self.stage.pick(end)
        self.send_response(HTTPStatus.SEE_OTHER)
        self.send_header("Location", "/")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""

    def _is_ours(self) -> bool:
        """Refuse pages of others, which may know the port but not under which name it is ours."""
        host = self.stage.url.removeprefix("http://").rstrip("/")
        origin = self.headers.get("Origin")
        if self.headers.get("Host") == host and origin in (None, f"http://{host}"):
            return True
        self.send_error(HTTPStatus.FORBIDDEN)
        return False

    def _answer(self, content: bytes, media_type: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", media_type)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Content-Security-Policy", _POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)


class StageConsole(Console):
    """Says on a stage what it says on the terminal."""

    def __init__(self, stage: Stage, results: bool = True) -> None:
        super().__init__(results)
        self._stage = stage

    def step(self, text: str) -> None:
        """Show the step that begins."""
        super().step(text)
        self._stage.say(f"<p><b>{html.escape(text)}</b></p>")

    def event(self, robot: str, event: dict[str, Any]) -> None:
        """Show what a robot did."""
        super().event(robot, event)
        line = event_sentence(event)
        if line:
            self._stage.say(f"<p>{html.escape(robot)}: {html.escape(line)}</p>")

    def table(
        self,
        title: str,
        columns: Sequence[str],
        rows: Sequence[Sequence[str]],
        narrow: Sequence[str] | None = None,
    ) -> None:
        """Show a table of results."""
        super().table(title, columns, rows, narrow)
        head = "".join(f'<th scope="col">{html.escape(name)}</th>' for name in columns)
        body = "".join(
            "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
            for row in rows
        )
        self._stage.say(
            f"<table><caption>{html.escape(title)}</caption><thead><tr>{head}</tr></thead>"
            f"<tbody>{body}</tbody></table>"
        )

    def line(self, text: str = "") -> None:
        """Show a line of results."""
        super().line(text)
        self._stage.say(f"<p>{html.escape(text)}</p>")
