"""Measure what opening a clip and showing one frame costs in USD, as .pdeanim and as the .usdc that it decodes to.

The same motion as .abc is read by Alembic's own library, if it is installed (alembic3d): usd-core reads no Alembic.

    python plugins/usd/measure.py CLIP.pdeanim ...

PXR_PLUGINPATH_NAME names the folder of the plug-in. Each figure is the smallest of runs in processes of their own, with
files in the system's cache; memory is what the process takes beyond USD and the plug-in.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

RUNS = 5
"""Processes per figure, in turns for all files."""

FRAME_SHARE = 0.618
"""Where in the clip the frame is that is read."""


def peak_memory() -> float:
    """Return the largest memory [MB] that the process had since the system's counter was reset (Linux)."""
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")]
    return float(line.split()[1]) / 1000


def usd_readers(path: Path) -> list[Callable[[float], Any]]:
    """Return functions that read the points of each shape at a share of the clip's time."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    attributes = [UsdGeom.PointBased(one).GetPointsAttr() for one in stage.Traverse() if one.IsA(UsdGeom.PointBased)]
    # Attributes do not keep their stage.
    return [lambda share, one=one, _=stage: one.Get(round(first + share * (last - first))) for one in attributes]


def alembic_readers(path: Path) -> list[Callable[[float], Any]]:
    """Return functions that read the points of each mesh at a share of its samples."""
    from alembic3d import Abc, AbcGeom

    archive = Abc.IArchive(str(path))
    found, left = [], [archive.getTop()]
    while left:
        node = left.pop()
        left += [node.getChild(index) for index in range(node.getNumChildren())]
        if AbcGeom.IPolyMesh.matches(node.getHeader()):
            found.append(AbcGeom.IPolyMesh(node, Abc.WrapExistingFlag.kWrapExisting).getSchema().getPositionsProperty())

    def points_at(positions: Any, share: float) -> Any:
        index = round(share * (positions.getNumSamples() - 1))
        return positions.getValue(Abc.ISampleSelector(positions.getTimeSampling().getSampleTime(index)))

    return [lambda share, one=one, _=archive: points_at(one, share) for one in found]


def measure(path: Path) -> None:
    """Print the seconds that opening, a frame and another one take, and the peak memory in MB."""
    import numpy as np

    # Libraries load their schemas and the plug-in, once in a process.
    if path.suffix == ".abc":
        from alembic3d import AbcGeom

        readers, _ = alembic_readers, AbcGeom
    else:
        from pxr import Plug, Usd

        empty = Usd.Stage.CreateInMemory()
        empty.DefinePrim("/a", "Mesh").GetAttributes()
        Plug.Registry().GetPluginWithName("pdeanim_usd").Load()
        readers = usd_readers
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_memory()
    ends = [time.perf_counter()]
    shapes = readers(path)
    ends.append(time.perf_counter())
    for share in (FRAME_SHARE, FRAME_SHARE + 0.01):
        for points in shapes:
            # A .usdc file is mapped: its bytes are read when they are looked at.
            np.array(points(share)).sum()
        ends.append(time.perf_counter())
    print(*np.diff(ends), peak_memory() - before)


def fewest(paths: list[Path]) -> list[list[float]]:
    """Return the smallest figures of each file."""
    found = [list[list[float]]() for _ in paths]
    for _ in range(RUNS):
        for path, rows in zip(paths, found, strict=True):
            text = subprocess.check_output([sys.executable, __file__, "--one", str(path)], text=True)
            rows.append([float(one) for one in text.split()])
    return [[min(column) for column in zip(*rows, strict=True)] for rows in found]


def main(clips: list[str]) -> None:
    """Print a row of a table for each clip."""
    import pdecodec
    from pdecodec.formats import write_sequence

    print(
        "| clip | frames x vertices | file | bytes on disk | open [ms] | one frame [ms] | the next [ms] | memory [MB] |"
    )
    print("|---|--:|---|--:|--:|--:|--:|--:|")
    for clip in map(Path, clips):
        with tempfile.TemporaryDirectory() as folder, pdecodec.open(clip) as animation:
            paths = [clip]
            for extension in ("usdc", *(["abc"] if find_spec("alembic3d") else [])):
                paths.append(Path(folder, f"{clip.stem}.{extension}"))
                write_sequence(animation, paths[-1], scene="drop")
            size = f"{animation.frame_count} x {animation.vertex_count:,}"
            for path, (*seconds, memory) in zip(paths, fewest(paths), strict=True):
                figures = " | ".join(f"{1000 * one:.1f}" for one in seconds)
                print(f"| {clip.stem} | {size} | {path.suffix} | {path.stat().st_size:,} | {figures} | {memory:.1f} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        measure(Path(sys.argv[2]))
    else:
        main(sys.argv[1:])
