"""A local page that lists the `.pdeanim` files of a folder, with pictures, and plays them.

The server only reads: it answers nothing but GET and HEAD. It listens on the loopback address, and refuses requests
that name another host, so that a page from elsewhere cannot read files through a host name that leads here. Only
files in the folder are served; links count as the files they lead to.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote_to_bytes, urlsplit

from pdecodec.report.viewer.view import list_page, served_page

LOOPBACK = "127.0.0.1"

RANGE = re.compile(r"bytes=([0-9]{1,18})-([0-9]{0,18})")
"""The form of a Range header that is answered; any other is ignored, as RFC 9110 allows."""

KIND = "application/octet-stream"
"""Content type of files; a browser never runs it."""

CHUNK_BYTES = 1 << 18
"""Size of the pieces in which a file is read and sent [bytes]."""


class FolderServer(ThreadingHTTPServer):
    """Serves one folder; `serve_forever` answers until `shutdown`.

    Parameters
    ----------
    folder : Path
    port : int
        0 chooses any free port.

    Raises
    ------
    OSError
        If the port is taken.
    """

    daemon_threads = True

    def __init__(self, folder: Path, port: int = 0) -> None:
        self.folder = folder.resolve()
        super().__init__((LOOPBACK, port), _Handler)

    @property
    def address(self) -> str:
        return f"http://{LOOPBACK}:{self.server_port}/"

    def files(self) -> Iterator[tuple[str, int]]:
        """Yield the name within the folder and the size [bytes] of each file; unreadable files are left out."""
        found = []
        for folder, _, names in os.walk(self.folder):
            for name in names:
                path = Path(folder, name).relative_to(self.folder).as_posix()
                size = self._size_of(self.place(path))
                if size is not None:
                    found.append((path, size))
        yield from sorted(found)

    def place(self, name: str) -> Path | None:
        """Return the path of a file that has this name in the folder; None if there is none."""
        try:
            path = (self.folder / name).resolve()
            is_ours = path.is_relative_to(self.folder) and path.suffix == ".pdeanim" and path.is_file()
        except (OSError, ValueError, RuntimeError):  # a name too long or with a NUL, a link that loops
            return None
        return path if is_ours else None

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print nothing about clients that disconnect and files that cannot be read."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)

    def _size_of(self, path: Path | None) -> int | None:
        try:
            return None if path is None else path.stat().st_size
        except OSError:  # removed in the meantime
            return None


class _Handler(BaseHTTPRequestHandler):
    server: FolderServer

    def do_GET(self) -> None:
        self._answer()

    def do_HEAD(self) -> None:
        self._answer()

    def _answer(self) -> None:
        if self.headers.get("Host") not in {f"{host}:{self.server.server_port}" for host in (LOOPBACK, "localhost")}:
            self.send_error(HTTPStatus.FORBIDDEN, "this server answers to the loopback address alone")
            return
        try:
            path = os.fsdecode(unquote_to_bytes(urlsplit(self.path).path))
        except ValueError:  # not an address
            self.send_error(HTTPStatus.BAD_REQUEST)
            return
        if path == "/":
            files = [(name, size, quote(os.fsencode(name))) for name, size in self.server.files()]
            self._send_page(list_page(self.server.folder.name, files))
            return
        if path == "/favicon.ico":  # browsers ask for it, and log an error if there is none
            self.send_response(HTTPStatus.NO_CONTENT)
            self.end_headers()
            return
        kind, _, name = path.removeprefix("/").partition("/")
        place = self.server.place(name)
        if place is None or kind not in {"view", "file"}:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif kind == "view":
            self._send_page(served_page(place.name, place.name, f"/file/{quote(os.fsencode(name))}"))
        else:
            self._send_file(place)

    def _send_page(self, page: str) -> None:
        content = page.encode(errors="replace")  # names that are not UTF-8 become question marks
        self._begin(HTTPStatus.OK, "text/html; charset=utf-8", len(content))
        if self.command == "GET":
            self.wfile.write(content)

    def _send_file(self, path: Path) -> None:
        try:
            file = path.open("rb")
        except OSError:  # not permitted, or removed in the meantime
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        with file:
            size = os.fstat(file.fileno()).st_size
            asked = RANGE.fullmatch(self.headers.get("Range", ""))
            if asked and asked[2] and int(asked[2]) < int(asked[1]):
                asked = None
            begin, end = (int(asked[1]), min(int(asked[2] or size) + 1, size)) if asked else (0, size)
            if asked and begin >= size:
                self._begin(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, KIND, 0, {"Content-Range": f"bytes */{size}"})
                return
            status = HTTPStatus.PARTIAL_CONTENT if asked else HTTPStatus.OK
            ranges = {"Content-Range": f"bytes {begin}-{end - 1}/{size}"} if asked else {}
            self._begin(status, KIND, end - begin, {"Accept-Ranges": "bytes", **ranges})
            if self.command != "GET":
                return
            file.seek(begin)
            while begin < end and (piece := file.read(min(CHUNK_BYTES, end - begin))):
                self.wfile.write(piece)
                begin += len(piece)

    def _begin(self, status: HTTPStatus, kind: str, length: int, more: dict[str, str] | None = None) -> None:
        self.send_response(status)
        headers = {"Content-Type": kind, "Content-Length": str(length), "X-Content-Type-Options": "nosniff"}
        for name, value in {**headers, "Cache-Control": "no-cache", **(more or {})}.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, *arguments: object) -> None:
        """Log nothing: the library does not print."""
