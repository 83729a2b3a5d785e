"""A local page that lists the `.pdeanim` files of a folder, with pictures, and plays them.

Reads only: nothing but GET and HEAD is answered. Bound to the loopback address; requests that name another host are
refused, so that no page from elsewhere reads files by a name that leads here. Paths are confined to the folder, links
included.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

from pdecodec.report.viewer.view import list_page, served_page

LOOPBACK = "127.0.0.1"

CHUNK_BYTES = 1 << 18
"""Of a file, read and sent at once."""


class FolderServer(ThreadingHTTPServer):
    """Serves one folder; `serve_forever` answers until `shutdown`.

    Parameters
    ----------
    folder : Path
    port : int
        0: any that is free.

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
        """Names within the folder, and bytes."""
        for path in sorted(self.folder.rglob("*.pdeanim")):
            if self.place(path.relative_to(self.folder).as_posix()) is not None:
                yield path.relative_to(self.folder).as_posix(), path.stat().st_size

    def place(self, name: str) -> Path | None:
        """The file of a name; none where it is not one of the folder's."""
        if "\0" in name:
            return None
        path = (self.folder / name).resolve()
        is_ours = path.is_relative_to(self.folder) and path.suffix == ".pdeanim" and path.is_file()
        return path if is_ours else None


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
        path = unquote(urlsplit(self.path).path)
        if path == "/":
            files = [(name, size, quote(name)) for name, size in self.server.files()]
            self._send_page(list_page(self.server.folder.name, files))
            return
        if path == "/favicon.ico":  # browsers ask for one, and log it as an error where there is none
            self.send_response(HTTPStatus.NO_CONTENT)
            self.end_headers()
            return
        kind, _, name = path.removeprefix("/").partition("/")
        place = self.server.place(name)
        if place is None or kind not in {"view", "file"}:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif kind == "view":
            self._send_page(served_page(place.name, place.name, f"/file/{quote(name)}"))
        else:
            self._send_file(place)

    def _send_page(self, page: str) -> None:
        content = page.encode()
        self._begin(HTTPStatus.OK, "text/html; charset=utf-8", len(content))
        if self.command == "GET":
            self.wfile.write(content)

    def _send_file(self, path: Path) -> None:
        size = path.stat().st_size
        asked = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        begin, end = (int(asked[1]), min(int(asked[2] or size - 1) + 1, size)) if asked else (0, size)
        if begin > end or (asked and begin >= size):
            self.send_error(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE)
            return
        status = HTTPStatus.PARTIAL_CONTENT if asked else HTTPStatus.OK
        ranges = {"Content-Range": f"bytes {begin}-{end - 1}/{size}"} if asked else {}
        self._begin(status, "application/octet-stream", end - begin, {"Accept-Ranges": "bytes", **ranges})
        if self.command != "GET":
            return
        with path.open("rb") as file:
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
        """Nothing: the library does not print."""
