"""`pdecodec view` and `pdecodec serve`: pages that play files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pdecodec.cli.console import byte_size, counted, put, say
from pdecodec.cli.options import assets_option, check_apart, fps_option, loudness_options, within_limits
from pdecodec.errors import InputError, SettingsError

if TYPE_CHECKING:
    from pdecodec.report.viewer.view import Original


@click.command()
@click.argument("first", metavar="FILE")
@click.argument("second", metavar="[FILE2]", required=False)
@click.option("--original", metavar="IN", help="What FILE was made from: the page shows where it differs.")
@click.option("-o", "--output", metavar="OUT", help="The page; FILE with the extension .html where nothing is said.")
@click.option("--overwrite", "-y", is_flag=True, help="Replace a page that exists.")
@fps_option
@assets_option(expose_value=False)
@within_limits
@loudness_options
def view(
    *,
    first: str,
    second: str | None,
    original: str | None,
    output: str | None,
    overwrite: bool,
    fps: float | None,
) -> None:
    """Write a page that plays .pdeanim files in a browser.

    All that the page needs is in it: it works offline, and from a disk. It plays at any speed, between frames too; with
    a second file, or the original, it shows both, and how far apart they are, at every vertex and over time.
    """
    from pdecodec.codec.opening import open_animation
    from pdecodec.report.viewer.view import view_page
    from pdecodec.system.whole_output import check_writable, whole_file

    if second and original:
        raise SettingsError("give a second file or --original, not both")
    paths = [Path(path) for path in (first, second) if path is not None]
    place = Path(output) if output else paths[0].with_suffix(".html")
    if place.suffix.lower() not in {".html", ".htm"}:
        raise SettingsError("a page is written; give it the extension .html", path=place)
    for path in paths:
        open_animation(path).close()
    check_writable(place, overwrite=overwrite)
    check_apart([first, second, original], [str(place)])
    up_axis, found = _prepared(paths[0], original, fps)
    title = " and ".join(path.name for path in paths)
    page = view_page(title, [(path.name, path.read_bytes()) for path in paths], original=found, up_axis=up_axis)
    with whole_file(place, overwrite=overwrite) as partial:
        partial.write_text(page, "utf-8")
    say(f"{title} -> {place} ({byte_size(place.stat().st_size)})")


def _prepared(path: Path, original: str | None, fps: float | None) -> tuple[str | None, Original | None]:
    """The up axis, and what the original differs by."""
    from pdecodec.codec.opening import open_animation
    from pdecodec.formats import open_sequence
    from pdecodec.report.viewer.view import difference

    with open_animation(path) as animation:
        up_axis = animation.metadata.get("up_axis")
        if original is None:
            return up_axis, None
        with open_sequence(original, fps=fps) as source:
            return up_axis, difference(animation, source, Path(original).name)


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
        raise InputError("is no folder; name the one that the .pdeanim files are in", code="invalid-input", path=place)
    try:
        server = FolderServer(place, port)
    except OSError as error:
        raise InputError(f"port {port} cannot be served on ({error.strerror}); choose another") from error
    with server:
        say(f"{counted(sum(1 for _ in server.files()), 'file')} of {place}; Ctrl-C ends this")
        put(server.address)
        server.serve_forever()
