"""`.pdeanim` files as mesh sequences: decoding behind the interface every other format has."""

from __future__ import annotations

from pathlib import Path

from pdecodec.errors import SettingsError
from pdecodec.sequence import MeshSequence


def open_pdeanim(path: Path, *, fps: float | None) -> MeshSequence:
    """Open an animation; its frames are those of the sequence it was encoded from.

    Raises
    ------
    SettingsError
        If `fps` is given: the file stores its own times.
    CorruptFileError
        If the file is damaged.
    """
    if fps is not None:
        raise SettingsError(
            "a .pdeanim file stores its own times; leave out the frame rate, or decode it at the times you want",
            path=path,
        )
    # pdecodec.decoder is imported when a file is opened: the command line starts without it.
    from pdecodec.decoder import open_animation

    return open_animation(path)
