"""`pdecodec view` and `pdecodec serve`: pages that play files."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import byte_size, counted, put, say, say_notices
from pdecodec.cli.jobs import local_input, local_output
from pdecodec.cli.options import check_apart, input_options, loudness_options, within_limits
from pdecodec.errors import InputError, SettingsError
from pdecodec.system.storage import RemoteFile, is_address

if TYPE_CHECKING:
    from pdecodec.formats.base.choosing import InputOptions
    from pdecodec.report.viewer.view import Original


@click.command()
@click.argument("first", metavar="FILE")
@click.argument("second", metavar="[FILE2]", required=False)
@click.option(
    "--original", metavar="IN", help="The input that FILE was encoded from; the page shows where they differ."
)
@click.option("-o", "--output", metavar="OUT", help="Page to write.  [default: FILE with the extension .html]")
@click.option("--overwrite", "-y", is_flag=True, help="Replace OUT if it exists.")
@input_options
@within_limits
@loudness_options
def view(
    *, first: str, second: str | None, original: str | None, output: str | None, overwrite: bool, **reading: Any
) -> None:
    """Write a page that plays .pdeanim files in a browser.

    The page contains everything it needs: it works offline and from a local disk. It plays at any speed, also between
    frames. With a second file or the original, it shows both, and the distance between them at every vertex and over
    time. Fields colour the mesh, with a legend, the value under the pointer, a chart of the vertex or face that is
    clicked, and, if there is an original, their errors. The original is read as by `pdecodec encode`: repeat the
    options that it was encoded with.
    """
    from pdecodec.codec.opening import open_animation
    from pdecodec.formats.base.choosing import InputOptions
    from pdecodec.report.viewer.view import view_page
    from pdecodec.system.whole_output import check_writable, whole_file

    asked = InputOptions(**reading)
    if second and original:
        raise SettingsError("give a second file or --original, not both", code="conflicting-settings")
    if original is None and asked != InputOptions():
        raise SettingsError("options for reading an original need --original; add it, or leave them out")
    sources = [source for source in (first, second) if source is not None]
    names = [RemoteFile(source).name if is_address(source) else Path(source).name for source in sources]
    page_path = output or str(Path(names[0] if is_address(first) else first).with_suffix(".html"))
    if Path(page_path).suffix.lower() not in {".html", ".htm"}:
        raise SettingsError("the output is a web page; give it the extension .html", path=page_path)
    with ExitStack() as stack:
        paths = [Path(stack.enter_context(local_input(source))) for source in sources]
        for path in paths:
            open_animation(path).close()
        place = stack.enter_context(local_output(page_path, overwrite=overwrite))
        check_writable(place, overwrite=overwrite)
        check_apart([first, second, original], [page_path])
        up_axis, found = _prepared(paths[0], original, asked)
        clips = [(name, path.read_bytes()) for name, path in zip(names, paths, strict=True)]
        page = view_page(" and ".join(names), clips, original=found, up_axis=up_axis)
        with whole_file(place, overwrite=overwrite) as partial:
            partial.write_text(page, "utf-8")
    say(f"{' and '.join(names)} -> {page_path} ({byte_size(len(page.encode()))})")


def _prepared(path: Path, original: str | None, asked: InputOptions) -> tuple[str | None, Original | None]:
    """Return the up axis and, if there is an original, its difference from the file."""
    from pdecodec.codec.opening import open_animation
    from pdecodec.formats.base.choosing import open_clip
    from pdecodec.report.viewer.view import difference

    with open_animation(path) as animation:
        up_axis = animation.metadata.get("up_axis")
        if original is None:
            return up_axis, None
        with open_clip(original, asked) as source:
            say_notices(source.notices)
            return up_axis, difference(animation, source, Path(original).name)


@click.command()
@click.argument("folder", metavar="FOLDER")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port to listen on.  [default: any free port]"
)
@loudness_options
def serve(*, folder: str, port: int) -> None:
    """Serve a local page that lists the .pdeanim files of a folder, with pictures, and plays them.

    The page is served on the loopback address, for this machine only. Nothing is written, and nothing outside the
    folder is read. Press Ctrl-C to stop.
    """
    from pdecodec.report.viewer.serve import FolderServer

    place = Path(folder)
    if is_address(folder):
        raise InputError(
            "is an address, and serve reads a local folder; name a folder", code="invalid-input", path=folder
        )
    if not place.is_dir():
        raise InputError(
            "is not a folder; name the folder that holds the .pdeanim files", code="invalid-input", path=place
        )
    try:
        server = FolderServer(place, port)
    except OSError as error:
        raise InputError(f"port {port} cannot be used ({error.strerror}); choose another", code="unreadable") from error
    with server:
        say(f"{counted(sum(1 for _ in server.files()), 'file')} of {place}; press Ctrl-C to stop")
        put(server.address)
        server.serve_forever()
