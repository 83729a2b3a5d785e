"""Measure what opening a clip and showing one frame costs in Blender: as .pdeanim, .abc and .usdc of the same motion.

    python plugins/blender/measure.py BLENDER_PYTHON CLIP.pdeanim ...

BLENDER_PYTHON is a Python with bpy and pdecodec; this one writes the other files. Each figure is the smallest of runs
in processes of their own, with files in the system's cache; memory is what the process takes beyond Blender.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

RUNS = 3
"""Processes per figure, in turns for all files."""

FRAME_SHARE = 0.618
"""Where in the clip the frame is that is shown."""


def peak_memory() -> float:
    """Return the largest memory [MB] that the process had since the system's counter was reset (Linux)."""
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")]
    return float(line.split()[1]) / 1000


def measure(path: Path) -> None:
    """Print the seconds that import and one frame take, and the peak memory in MB."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    import bpy
    import numpy as np

    import pdecodec
    from plugins import blender

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender.register()
    # The modules of pdecodec load once in a session.
    pdecodec.open  # noqa: B018
    imports = {".abc": bpy.ops.wm.alembic_import, ".usdc": bpy.ops.wm.usd_import}
    load = imports.get(path.suffix, bpy.ops.import_scene.pdeanim)
    scene = bpy.context.scene
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_memory()
    start = time.perf_counter()
    load(filepath=str(path))
    bpy.context.evaluated_depsgraph_get()
    opened = time.perf_counter()
    scene.frame_set(round(scene.frame_start + FRAME_SHARE * (scene.frame_end - scene.frame_start)))
    graph = bpy.context.evaluated_depsgraph_get()
    for thing in scene.objects:
        if thing.type == "MESH":
            vertices = thing.evaluated_get(graph).data.vertices
            vertices.foreach_get("co", np.zeros(3 * len(vertices), np.float32))
    shown = time.perf_counter()
    print("FOUND", opened - start, shown - opened, peak_memory() - before)


def fewest(python: str, paths: list[Path]) -> list[list[float]]:
    """Return the smallest figures of each file."""
    found = [list[list[float]]() for _ in paths]
    for _ in range(RUNS):
        for path, rows in zip(paths, found, strict=True):
            text = subprocess.check_output([python, __file__, "--one", str(path)], text=True)
            (line,) = [line for line in text.splitlines() if line.startswith("FOUND")]
            rows.append([float(one) for one in line.split()[1:]])
    return [[min(column) for column in zip(*rows, strict=True)] for rows in found]


def main(python: str, clips: list[str]) -> None:
    """Print a row of a table for each clip and file."""
    import pdecodec

    print("| clip | frames x vertices | file | bytes on disk | open [ms] | one frame [ms] | memory [MB] |")
    print("|---|--:|---|--:|--:|--:|--:|")
    for clip in map(Path, clips):
        with tempfile.TemporaryDirectory() as folder, pdecodec.open(clip) as animation:
            others = [Path(folder, f"{clip.stem}{extension}") for extension in (".abc", ".usdc")]
            for path in others:
                pdecodec.write_sequence(animation, path, scene="drop")
            size = f"{animation.frame_count} x {animation.vertex_count:,}"
            files = [clip, *others]
            for path, (opened, shown, memory) in zip(files, fewest(python, files), strict=True):
                figures = f"{path.stat().st_size:,} | {opened * 1000:.0f} | {shown * 1000:.1f} | {memory:.0f}"
                print(f"| {clip.stem} | {size} | {path.suffix} | {figures} |", flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        measure(Path(sys.argv[2]))
    else:
        main(sys.argv[1], sys.argv[2:])
