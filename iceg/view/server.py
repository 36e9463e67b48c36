"""A server for one person on this machine: the page of a run, and the edits that it asks for.

It listens on the loopback interface only. Whoever asks must know a token, which is new each time and stands in the
address that is printed, and must ask for this very host, so that no page of another origin and no name that is made to
point here gets anything. What can be asked for is a table; no path of a request ever becomes a path of a file.
"""

import json
import secrets
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, cast
from urllib.parse import parse_qs, urlsplit

from graph.errors import IcegError, reason
from iceg.view.errors import ViewError
from iceg.view.session import Session, StaleEditError

PAGE = "report.html"
_HOST = "127.0.0.1"
_MOST_BYTES = 65_536
"""Of what is asked for."""
_PATIENCE = 20.0
"""Seconds for a request to come in, and for an answer to be taken."""
_MARK = b"<head>"
"""Behind it the page is told that it is served."""
_EDITS = ("forbid", "add", "drag", "pin", "withdraw", "undo")
_HEADERS = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'unsafe-inline' data:; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
}


class RefusedError(ViewError):
    """A request that is not answered as it asks."""

    def __init__(self, status: HTTPStatus, what: str) -> None:
        super().__init__(what)
        self.status = status


class ViewServer(ThreadingHTTPServer):
    """Serves one session; `serve_forever` until it is shut down or interrupted."""

    daemon_threads = True

    def __init__(self, session: Session, port: int = 0) -> None:
        """Listen, without answering yet.

        Args:
            session: the run.
            port: to listen on; 0 for any that is free.

        Raises:
            ViewError: the port cannot be had.
        """
        try:
            super().__init__((_HOST, port), _Handler)
        except (OSError, OverflowError) as err:
            told = reason(err) if isinstance(err, OSError) else "expected 0 to 65535"
            raise ViewError(f"{_HOST}:{port}: cannot be listened on: {told}") from err
        self.session = session
        self.token = secrets.token_urlsafe(24)

    @property
    def hosts(self) -> tuple[str, ...]:
        """What a request may call this server."""
        return (f"{_HOST}:{self.server_port}", f"localhost:{self.server_port}")

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://{_HOST}:{self.server_port}/?token={self.token}"

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ANN401
        """Nothing: a browser may be closed, or fall silent, at any time."""


class _Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    server_version, sys_version = "iceg", ""
    timeout = _PATIENCE

    def do_GET(self) -> None:
        """The page, or the state of the corrections."""
        self._answer(self._get)

    def do_POST(self) -> None:
        """An edit."""
        self._answer(self._post)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002, ANN401
        """Nothing: requests are not news."""

    @property
    def _of(self) -> ViewServer:
        return cast("ViewServer", self.server)

    def _answer(self, respond: Any) -> None:  # noqa: ANN401
        try:
            respond()
        except RefusedError as err:
            self._send_json({"error": str(err)}, err.status)
        except StaleEditError as err:
            self._send_json({"error": str(err), **self._of.session.state()}, HTTPStatus.CONFLICT)
        except IcegError as err:
            self._send_json({"error": str(err)}, HTTPStatus.UNPROCESSABLE_ENTITY)
        except (ConnectionError, TimeoutError):
            self.close_connection = True
        except Exception as err:  # noqa: BLE001 whoever asked is told, and the server goes on
            self._send_json({"error": f"{type(err).__name__}: {err}"[:300]}, HTTPStatus.INTERNAL_SERVER_ERROR)

    def _get(self) -> None:
        asked = urlsplit(self.path)
        self._check_host()
        if asked.path == "/":
            self._check_token(parse_qs(asked.query).get("token", [""])[0])
            self._send(self._page(), "text/html; charset=utf-8")
        elif asked.path == "/state":
            self._check_token(self.headers.get("X-Iceg-Token", ""))
            self._send_json(self._of.session.state())
        else:
            raise RefusedError(HTTPStatus.NOT_FOUND, "there is nothing here of that name")

    def _post(self) -> None:
        self._check_host()
        self._check_token(self.headers.get("X-Iceg-Token", ""))
        name = urlsplit(self.path).path.removeprefix("/")
        if name not in _EDITS:
            raise RefusedError(HTTPStatus.NOT_FOUND, f"expected one of {', '.join(_EDITS)}")
        self._send_json(self._of.session.edit(name, self._body()))

    def _check_host(self) -> None:
        """Refuse who calls this server by another name, and pages of other origins."""
        if self.headers.get("Host", "") not in self._of.hosts:
            raise RefusedError(HTTPStatus.FORBIDDEN, "open the address that iceg has printed")
        origin = self.headers.get("Origin")
        if origin is not None and origin not in [f"http://{host}" for host in self._of.hosts]:
            raise RefusedError(HTTPStatus.FORBIDDEN, "this page may not ask for that")

    def _check_token(self, token: str) -> None:
        if not secrets.compare_digest(token.encode(), self._of.token.encode()):
            raise RefusedError(HTTPStatus.FORBIDDEN, "the token is missing or wrong: open the address iceg has printed")

    def _body(self) -> Mapping[str, Any]:
        if self.headers.get_content_type() != "application/json":
            raise RefusedError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected JSON")
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit() and int(length) <= _MOST_BYTES):
            raise RefusedError(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected a Content-Length of at most {_MOST_BYTES}"
            )
        try:
            found = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError) as err:
            raise RefusedError(HTTPStatus.BAD_REQUEST, "expected JSON, found none") from err
        if not isinstance(found, dict):
            raise RefusedError(HTTPStatus.BAD_REQUEST, f"expected an object, found {type(found).__name__}")
        return found

    def _page(self) -> bytes:
        """The page of the run, told that it is served, and by whom."""
        directory = self._of.session.directory.resolve()
        path = Path(directory, PAGE)
        if not path.is_file() or path.resolve().parent != directory:
            raise RefusedError(HTTPStatus.NOT_FOUND, f"the folder holds no {PAGE}")
        facts = {"token": self._of.token, "state": self._of.session.state()}
        told = json.dumps(facts).replace("<", "\\u003c")
        return path.read_bytes().replace(_MARK, _MARK + f"<script>window.icegServed = {told};</script>".encode(), 1)

    def _send_json(self, value: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(json.dumps(value, ensure_ascii=False).encode(), "application/json; charset=utf-8", status)

    def _send(self, content: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        try:
            self.send_response(status)
            for name, value in _HEADERS.items():
                self.send_header(name, value)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)
        except (ConnectionError, TimeoutError):
            self.close_connection = True
