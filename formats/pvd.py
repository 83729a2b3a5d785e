"""ParaView's `.pvd` files: lists of VTU files with their times."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.frame_sequence import FrameSequence
from pdecodec.formats.meshio_files import read_with_meshio
from pdecodec.formats.sample_times import rate_or_default, round_rate
from pdecodec.sequence import MeshSequence, check_times


def open_pvd(path: Path, *, fps: float | None) -> MeshSequence:
    """Open a list of VTU files.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
        Nominal rate; the list has times.

    Raises
    ------
    InputError
        If it is damaged, its times do not increase, a step has several parts, or the first file cannot be used.
    """
    try:
        entries = ElementTree.parse(path).getroot().findall("./Collection/DataSet")
        steps = [(float(entry.get("timestep", "nan")), entry.get("file", "")) for entry in entries]
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"is no PVD file, or a damaged one ({error}); write it again", path=path) from error
    if not steps or any(not math.isfinite(time) or not file for time, file in steps):
        raise InputError("lists no files with times; write it again", path=path)
    if len({time for time, _ in steps}) < len(steps):
        raise InputError("lists several files for one time; join the parts first", path=path)
    steps.sort()
    stored = np.array([time for time, _ in steps])
    found = round_rate((stored.size - 1) / float(stored[-1] - stored[0])) if stored.size > 1 else None
    rate, notices = rate_or_default(found, fps)
    times, rate = check_times(stored.size, stored, rate)
    return FrameSequence([path.parent / file for _, file in steps], times, rate, read_with_meshio, notices)
