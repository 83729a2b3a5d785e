"""`pdecodec serve`: a local page that plays the files of a folder."""

from __future__ import annotations

from pathlib import Path

import click

from pdecodec.cli.console import counted, put, say
from pdecodec.cli.options import loudness_options
from pdecodec.errors import InputError


@click.command()
@click.argument("folder", metavar="FOLDER")
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="A free one where nothing is said.")
@loudness_options
def serve(*, folder: str, port: int) -> None:
    """Serve a local page that lists the .pdeanim files of a folder, with pictures, and plays them.

    The page is for this machine alone: the loopback address. Nothing is written, and nothing outside the folder is
    read. Ctrl-C ends it.
    """
    from pdecodec.report.viewer.serve import FolderServer

    place = Path(folder)
    if not place.is_dir():
        raise InputError("is no folder; name the one that the .pdeanim files are in", path=place)
    try:
        server = FolderServer(place, port)
    except OSError as error:
        raise InputError(f"port {port} cannot be served on ({error.strerror}); choose another") from error
    with server:
        say(f"{counted(sum(1 for _ in server.files()), 'file')} of {place}; Ctrl-C ends this")
        put(server.address)
        server.serve_forever()
