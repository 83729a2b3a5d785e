"""`pdecodec serve`: a local page that lists the files of a folder and plays them."""

from __future__ import annotations

import http.client
import os
import shutil
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from pdecodec import open_animation
from pdecodec.cli.main import run
from pdecodec.report.viewer.serve import FolderServer
from spec.vector_files import accepted_files, accepted_vectors
from tests.support.driven_browser import browsing
from tests.support.remote_server import answering


@contextmanager
def served(folder: Path) -> Iterator[FolderServer]:
    with FolderServer(folder) as server, answering(server):
        yield server


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FolderServer]:
    """Serve a folder with two files, one of them in a subfolder, next to another file and a link to the outside."""
    root: Path = tmp_path_factory.mktemp("served")
    folder = root / "clips"
    (folder / "more <i>").mkdir(parents=True)
    shutil.copy(accepted_files()["groups"], folder / "groups.pdeanim")
    shutil.copy(accepted_files()["several_objects"], folder / "more <i>" / "a#b.pdeanim")
    shutil.copy(accepted_files()["lines"], root / "outside.pdeanim")
    (folder / "link.pdeanim").symlink_to(root / "outside.pdeanim")
    (folder / "loop.pdeanim").symlink_to("loop.pdeanim")
    (folder / "secret.txt").write_text("no animation")
    with served(folder) as opened:
        yield opened


def asked(server: FolderServer, path: str, method: str = "GET", **headers: str) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    found = answer.status, answer.read()
    connection.close()
    return found


def test_files_are_listed_and_given_whole_or_in_parts(server: FolderServer) -> None:
    assert [name for name, _ in server.files()] == ["groups.pdeanim", "more <i>/a#b.pdeanim"]
    data = accepted_vectors()["groups"]
    assert asked(server, "/file/groups.pdeanim") == (200, data)
    assert asked(server, "/file/groups.pdeanim", Range="bytes=10-19") == (206, data[10:20])
    assert asked(server, "/file/groups.pdeanim", Range=f"bytes={len(data) - 3}-") == (206, data[-3:])
    assert asked(server, "/file/groups.pdeanim", Range=f"bytes={len(data)}-")[0] == 416
    for none in ("bytes=5-4", "bytes=9999-1", "bytes=-5", "bytes=1-2,4-5", "bytes=²-", f"bytes={'9' * 5000}-", "x"):
        assert asked(server, "/file/groups.pdeanim", Range=none) == (200, data)
    assert asked(server, "/file/groups.pdeanim", method="HEAD") == (200, b"")
    assert asked(server, "/file/more%20%3Ci%3E/a%23b.pdeanim")[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        "/file/../outside.pdeanim",
        "/file/%2e%2e/outside.pdeanim",
        "/file/..%2foutside.pdeanim",
        "/file//etc/passwd",
        "/file/link.pdeanim",
        "/file/secret.txt",
        "/file/none.pdeanim",
        "/file/a%00.pdeanim",
        f"/file/{'long' * 1000}.pdeanim",
        "/view/loop.pdeanim",
        "/view/secret.txt",
        "/other/groups.pdeanim",
    ],
)
def test_nothing_but_files_of_the_folder_is_given(server: FolderServer, path: str) -> None:
    assert asked(server, path)[0] == 404


def test_names_that_are_not_utf8_are_listed_and_played(tmp_path: Path) -> None:
    try:
        shutil.copy(accepted_files()["groups"], os.path.join(os.fsencode(tmp_path), b"a\xff.pdeanim"))
    except OSError:
        pytest.skip("names are UTF-8 in this file system")
    with served(tmp_path) as server:
        assert b"/file/a%FF.pdeanim" in asked(server, "/view/a%FF.pdeanim")[1]
        assert b'"address": "a%FF.pdeanim"' in asked(server, "/")[1]
        assert asked(server, "/file/a%FF.pdeanim") == (200, accepted_vectors()["groups"])


def test_nothing_that_clients_and_files_do_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with (tmp_path / "large.pdeanim").open("wb") as large:
        large.truncate(1 << 28)
    with served(tmp_path) as server:
        for path, answer in ((b"http://[/", b"HTTP/1.0 400"), (b"/file/large.pdeanim", b"HTTP/1.0 200")):
            with socket.create_connection(("127.0.0.1", server.server_port)) as leaving:
                leaving.sendall(b"GET %s HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % (path, server.server_port))
                assert leaving.recv(100).startswith(answer)
                leaving.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset
        (tmp_path / "large.pdeanim").unlink()
        assert asked(server, "/file/large.pdeanim")[0] == 404
        for thread in threading.enumerate():
            if "process_request_thread" in thread.name:
                thread.join(30)
    assert capsys.readouterr() == ("", "")


def test_a_browser_that_asks_for_an_icon_logs_no_error(server: FolderServer) -> None:
    assert asked(server, "/favicon.ico") == (204, b"")


def test_other_hosts_and_other_methods_are_refused(server: FolderServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    assert asked(server, "/", Host="evil.example")[0] == 403
    assert asked(server, "/", Host=f"localhost:{server.server_port}")[0] == 200
    for method in ("POST", "PUT", "DELETE"):
        assert asked(server, "/file/groups.pdeanim", method=method)[0] == 501


def test_the_list_has_pictures_and_its_pages_play(server: FolderServer, tmp_path: Path) -> None:
    with browsing(tmp_path / "profile") as browser:
        browser.open(server.address)
        drawn = (
            "const list = await pdeanimList; await new Promise((next) => setTimeout(next, 500)); await list.last;"
            "return [...document.querySelectorAll('canvas')].map((canvas) => new Set(canvas.getContext('2d')"
            ".getImageData(0, 0, canvas.width, canvas.height).data).size)"
        )
        colours = browser.run(drawn)
        assert len(colours) == 2
        assert min(colours) > 5, "something is drawn"
        assert "more <i>/a#b.pdeanim" in browser.run("return document.body.innerText")
        addresses = browser.run("return [...document.querySelectorAll('a')].map((link) => link.href)")
        browser.open(addresses[1])
        browser.run("await pdeanimView.ready")
        found = browser.run("return pdeanimView.readPositions(0.1).positions")
        with open_animation(accepted_files()["several_objects"]) as animation:
            expected = animation.positions(0.1)
        assert np.abs(np.reshape(found, (-1, 3)) - expected).max() <= 1e-5 * (1 + np.abs(expected).max())
        assert browser.errors() == []


def test_serving_a_missing_folder_fails_with_one_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert run(["serve", str(tmp_path / "none")]) == 3
    assert "is not a folder" in capsys.readouterr().err
