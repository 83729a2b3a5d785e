"""A local server of a folder that serves byte ranges and counts bytes and requests."""

from __future__ import annotations

import gzip
import mimetypes
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlsplit


@cache
def _packed(data: bytes) -> bytes:
    """Return a file's bytes as gzip packs them; servers keep them, too."""
    return gzip.compress(data, 6)


class Server(ThreadingHTTPServer):
    """A server that counts requests, and the bytes of their bodies."""

    folder: Path
    gives_ranges = True
    compresses = False
    bytes_given = 0
    requests = 0

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: Server

    def do_GET(self) -> None:
        self._answer(has_body=True)

    def do_HEAD(self) -> None:
        self._answer(has_body=False)

    def _answer(self, *, has_body: bool) -> None:
        path = self.server.folder / unquote(urlsplit(self.path).path).lstrip("/")
        if not path.is_file():
            self.send_error(404)
            return
        data = path.read_bytes()
        if self.server.compresses:
            data = _packed(data)
        asked = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        begin, end = 0, len(data)
        if asked and self.server.gives_ranges:
            begin, end = int(asked[1]), min(int(asked[2] or len(data) - 1) + 1, len(data))
            if begin >= len(data):
                self.send_error(416)
                return
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {begin}-{end - 1}/{len(data)}")
        else:
            self.send_response(200)
        if self.server.gives_ranges:
            self.send_header("Accept-Ranges", "bytes")
        self.send_header("Content-Type", mimetypes.guess_type(path.name)[0] or "application/octet-stream")
        self.send_header("Content-Length", str(end - begin))
        if self.server.compresses:
            self.send_header("Content-Encoding", "gzip")
        self.end_headers()
        self.server.requests += 1
        if has_body:
            self.server.bytes_given += end - begin
            self.wfile.write(data[begin:end])

    def log_message(self, *_: object) -> None:
        """Log nothing."""


@contextmanager
def serving(folder: Path) -> Iterator[Server]:
    """Serve the files of a folder on a free port during this block."""
    with Server(("127.0.0.1", 0), _Handler) as server:
        server.folder = folder
        with answering(server):
            yield server


@contextmanager
def answering(server: ThreadingHTTPServer) -> Iterator[None]:
    """Answer a server's requests in a separate thread during this block."""
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join()
