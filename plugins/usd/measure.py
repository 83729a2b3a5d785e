"""Measure what opening a clip and showing one frame costs in USD, as .pdeanim and as the .usdc that it decodes to.

    python plugins/usd/measure.py CLIP.pdeanim ...

PXR_PLUGINPATH_NAME names the folder of the plug-in. Each figure is the smallest of runs in processes of their own, with
files in the system's cache; memory is what the process takes beyond USD and the plug-in.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

RUNS = 5
"""Processes per figure, in turns for both files."""

FRAME_SHARE = 0.618
"""Where in the clip the frame is that is read."""


def peak_memory() -> float:
    """Return the largest memory [MB] that the process had since the system's counter was reset (Linux)."""
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")]
    return float(line.split()[1]) / 1000


def measure(path: Path) -> None:
    """Print the seconds that opening, a frame and the next one take, and the peak memory in MB."""
    import numpy as np
    from pxr import Plug, Usd, UsdGeom

    # USD loads its schemas and the plug-in, once in a process.
    empty = Usd.Stage.CreateInMemory()
    empty.DefinePrim("/a", "Mesh").GetAttributes()
    Plug.Registry().GetPluginWithName("pdeanim_usd").Load()
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_memory()
    start = time.perf_counter()
    stage = Usd.Stage.Open(str(path))
    prims = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.PointBased)]
    opened = time.perf_counter()
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    code = round(first + FRAME_SHARE * (last - first))
    ends = [opened]
    for frame in (code, code + 1):
        for prim in prims:
            # A .usdc file is mapped: its bytes are read when they are looked at.
            np.array(UsdGeom.PointBased(prim).GetPointsAttr().Get(frame)).sum()
        ends.append(time.perf_counter())
    print(opened - start, *np.diff(ends), peak_memory() - before)


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
            stage = Path(folder, f"{clip.stem}.usdc")
            write_sequence(animation, stage, scene="drop")
            size = f"{animation.frame_count} x {animation.vertex_count:,}"
            for path, (*seconds, memory) in zip((clip, stage), fewest([clip, stage]), strict=True):
                figures = " | ".join(f"{1000 * one:.1f}" for one in seconds)
                print(f"| {clip.stem} | {size} | {path.suffix} | {path.stat().st_size:,} | {figures} | {memory:.1f} |")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        measure(Path(sys.argv[2]))
    else:
        main(sys.argv[1:])
