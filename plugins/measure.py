"""Measure what opening a clip and showing frames cost in a program, as .pdeanim and in the files that it reads anyway.

    python plugins/measure.py blender PYTHON CLIP.pdeanim ...

The program is blender, paraview, pyvista or usd, and PYTHON the interpreter that has it and pdecodec (for ParaView,
pvpython; for USD, PXR_PLUGINPATH_NAME names the folder of the plug-in); the one that runs this file writes the other
files. Each figure is the smallest of runs in processes of their own, with files in the system's cache: processor time
of all threads, and the memory that the process takes beyond the program and the modules of pdecodec.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

RUNS = 5
"""Processes per figure, in turns for all files."""

FRAME_SHARES = (0.618, 0.382)
"""Where in the clip the two frames are that are shown."""

OTHER_FILES = {
    "blender": (".abc", ".usdc"), "paraview": (".pvd", ".xdmf"), "pyvista": (".pvd", ".xdmf"), "usd": (".usdc", ".abc"),
}  # fmt: skip
"""Extensions of the files that each program is given besides .pdeanim; .pvd lists one .vtu for each frame."""


def blender(path: Path) -> Iterator[Any]:
    """Import a clip, and show frames on its evaluated meshes."""
    import bpy
    import numpy as np

    from plugins import blender as extension

    bpy.ops.wm.read_factory_settings(use_empty=True)
    extension.register()
    imports = {".abc": bpy.ops.wm.alembic_import, ".usdc": bpy.ops.wm.usd_import}
    scene = bpy.context.scene
    yield
    imports.get(path.suffix, bpy.ops.import_scene.pdeanim)(filepath=str(path))
    yield bpy.context.evaluated_depsgraph_get()
    for share in FRAME_SHARES:
        scene.frame_set(round(scene.frame_start + share * (scene.frame_end - scene.frame_start)))
        graph = bpy.context.evaluated_depsgraph_get()
        for thing in scene.objects:
            if thing.type == "MESH":
                vertices = thing.evaluated_get(graph).data.vertices
                vertices.foreach_get("co", np.zeros(3 * len(vertices), np.float32))
        yield


def paraview(path: Path) -> Iterator[Any]:
    """Open a file and update the reader for the times of frames."""
    from paraview import simple

    import pdecodec.paraview

    folder = Path(pdecodec.paraview.__file__).parent
    simple.LoadPlugin(str(folder / "pdecodec_reader.py"), remote=False, ns=globals())
    yield
    reader = simple.OpenDataFile(str(path))
    reader.UpdatePipelineInformation()
    times = list(reader.TimestepValues)
    yield
    for share in FRAME_SHARES:
        reader.UpdatePipeline(times[round(share * (len(times) - 1))])
        yield


def pyvista(path: Path) -> Iterator[Any]:
    """Get the reader of a file, and read the times of frames."""
    import pyvista as library

    yield
    reader = library.get_reader(str(path))
    times = reader.time_values
    yield
    for share in FRAME_SHARES:
        reader.set_active_time_value(times[round(share * (len(times) - 1))])
        yield reader.read()


def usd(path: Path) -> Iterator[Any]:
    """Open a layer as a stage, and read the points of frames; .abc files are read by Alembic's own library."""
    import numpy as np
    from pxr import Plug, Usd

    # Libraries load their schemas and the plug-in, once in a process.
    if path.suffix == ".abc":
        from alembic3d import AbcGeom  # noqa: F401
    else:
        empty = Usd.Stage.CreateInMemory()
        empty.DefinePrim("/a", "Mesh").GetAttributes()
        Plug.Registry().GetPluginWithName("pdeanim_usd").Load()
    yield
    readers = alembic_readers(path) if path.suffix == ".abc" else usd_readers(path)
    yield
    for share in FRAME_SHARES:
        for points in readers:
            # A .usdc file is mapped: its bytes are read when they are looked at.
            np.array(points(share)).sum()
        yield


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


def peak_memory() -> float:
    """Return the largest memory [MB] that the process had since the system's counter was reset (Linux)."""
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")]
    return float(line.split()[1]) / 1000


def measure(program: str, path: Path) -> None:
    """Print the seconds that opening, a frame and another one take, and the peak memory in MB."""
    import pdecodec

    pdecodec.open_animation, pdecodec.bake_transforms  # noqa: B018 - the modules of pdecodec load once in a session
    steps = {"blender": blender, "paraview": paraview, "pyvista": pyvista, "usd": usd}[program](path)
    next(steps)
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_memory()
    ends = [time.process_time(), *(time.process_time() for _ in steps)]
    print("FOUND", *(last - first for first, last in pairwise(ends)), peak_memory() - before)


def fewest(program: str, python: str, paths: list[Path]) -> list[list[float]]:
    """Return the smallest figures of each file."""
    found = [list[list[float]]() for _ in paths]
    for _ in range(RUNS):
        for path, rows in zip(paths, found, strict=True):
            text = subprocess.check_output([python, __file__, "--one", program, str(path)], text=True)
            (line,) = [line for line in text.splitlines() if line.startswith("FOUND")]
            rows.append([float(one) for one in line.split()[1:]])
    return [[min(column) for column in zip(*rows, strict=True)] for rows in found]


def main(program: str, python: str, clips: list[str]) -> None:
    """Print a row of a table for each clip and file."""
    import pdecodec

    print("| clip | frames x vertices | file | bytes on disk | open [ms] | a frame [ms] | another [ms] | memory [MB] |")
    print("|---|--:|---|--:|--:|--:|--:|--:|")
    for clip in map(Path, clips):
        with tempfile.TemporaryDirectory() as folder, pdecodec.open(clip) as animation:
            files = [clip]
            for extension in OTHER_FILES[program]:
                files.append(Path(folder, extension[1:], f"{clip.stem}{extension}"))
                files[-1].parent.mkdir()
                pdecodec.write_sequence(animation, files[-1], scene="drop")
            title = f"{clip.stem} | {animation.frame_count} x {animation.vertex_count:,}"
            for path, (*seconds, memory) in zip(files, fewest(program, python, files), strict=True):
                size = sum(one.stat().st_size for one in path.parent.iterdir()) if path != clip else clip.stat().st_size
                figures = " | ".join(f"{1000 * one:.1f}" for one in seconds)
                print(f"| {title} | {path.suffix} | {size:,} | {figures} | {memory:.0f} |", flush=True)
                title = " | "


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        # First, this folder would hide the package paraview, or the checkout an installed pdecodec.
        sys.path[:] = [*sys.path[1:], str(Path(__file__).resolve().parents[1])]
        measure(sys.argv[2], Path(sys.argv[3]))
    else:
        main(sys.argv[1], sys.argv[2], sys.argv[3:])
