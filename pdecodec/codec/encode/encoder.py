"""The encoder: a mesh sequence in, a `.pdeanim` file out, a group of frames in memory at a time.

The way of a position: frame 0 becomes the reference frame on a grid (REST); each group of frames is fitted with
functions of time and of space, which the profile chooses (:mod:`pdecodec.codec.encode.auto_profile`,
:mod:`pdecodec.codec.encode.paper_profile`); its coefficients are quantised and coded (TIME, COEF), and what then misses
the bound gets a residual (CORR): all of that is :mod:`pdecodec.codec.encode.group_fit`.
:mod:`pdecodec.codec.encode.group_encoder` goes from group to group and gathers the sections.
"""

from __future__ import annotations

import os
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from pdecodec.codec.encode.profiles import make_encoder
from pdecodec.codec.encode.report import EncodeReport
from pdecodec.codec.encode.run_encoder import encode_runs
from pdecodec.codec.settings import EncodeSettings
from pdecodec.errors import SettingsError
from pdecodec.mesh.rounding import rounding_noticed
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.storage import is_address, remote_output
from pdecodec.system.whole_output import check_writable


def encode(
    sequence: MeshSequence,
    path: str | os.PathLike[str] | None = None,
    settings: EncodeSettings | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> EncodeReport:
    """Encode a mesh sequence.

    Parameters
    ----------
    sequence : MeshSequence
        Read once from front to back, after a look at a few windows of it. Of a :class:`pdecodec.ChangingSequence` one
        run is read and encoded after the other; tolerances are of the diagonal of its first frame. Bounds count from
        the float32 positions that it gives: how far those are from its own, `rounding` of the report says.
    path : path-like, optional
        The `.pdeanim` file, or its address; it appears whole or not at all. Without one its bytes are in the report.
    settings : EncodeSettings, optional
    overwrite : bool
        Whether an existing file may be replaced.
    progress : callable, optional
    **options
        Fields of :class:`EncodeSettings`, in place of those of `settings`: ``encode(clip, path, tolerance=1e-4)``.

    Returns
    -------
    EncodeReport

    Raises
    ------
    InputError
        If positions are not finite, the sequence cannot be read, or the output cannot be written.
    SettingsError
        If settings are out of range or an option is unknown.
    """
    known = {item.name for item in fields(EncodeSettings)}
    for name in options:
        if name not in known:
            raise SettingsError(f"there is no setting named {name}; there are {', '.join(sorted(known))}")
    chosen = replace(settings or EncodeSettings(), **options)
    if path is not None and is_address(path):
        with remote_output(str(path), overwrite=overwrite) as local:
            return replace(encode(sequence, local, chosen, progress=progress), path=str(path))
    target = None if path is None else Path(path)
    if target is not None:
        check_writable(target, overwrite=overwrite)
    with rounding_noticed() as rounding:
        if isinstance(sequence, ChangingSequence):
            report = encode_runs(sequence, chosen, target, overwrite=overwrite, progress=progress)
        else:
            report = make_encoder(sequence, chosen, progress).run(target, overwrite=overwrite)
    return replace(report, rounding=rounding.largest)
