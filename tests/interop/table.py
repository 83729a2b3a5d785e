"""`make interop`: convert real files and back, and show them in other programs; writes docs/interop.md.

    python -m tests.interop.table docs/interop.md [scenes] [sequences] [exodus]

PDECODEC_DATA names the folder of shared data, PDECODEC_BLENDER a Python with the package bpy, PDECODEC_NODE_MODULES
a folder with gltf-validator and three. The page names missing tools and files.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from pdecodec.errors import PdecodecError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.attribute_roles import MATERIAL, face_sets, uv_sets
from pdecodec.formats.base.scene_space import UNIT, UP_AXIS, place
from pdecodec.formats.base.transforms import bake_transforms
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import ArraySequence, MeshSequence
from tests.interop.comparing import Expected, difference, expected_of
from tests.interop.viewers import Job, Seen, blender_shows, openusd_shows, three_shows
from tests.support.browser_tools import gltf_issues

HEAD = """\
# What other programs see

Written by `make interop` from the shared files; do not edit. Every file is opened and written as Alembic, USD and
glTF, and these are opened by other programs. Of clips with more than 48 frames, the first 48 are used. Distances are
the largest error of any point, divided by the diagonal of the first frame's bounding box: first at the first, a
middle and the last frame, then at times between frames, compared with the straight line from frame to frame. If a
part turns rigidly, its node turns between frames instead of moving straight. Animations of a glb begin at 0: it is
looked at from there. Normals are those of corners at these frames: the angle that 99 % do not exceed, and the
largest, for faces with an area. Those marked "to source" are compared with the normals of the source as the same
program shows it. The others are compared with ours, because the source has none, or the program cannot show them.
If a source has no normals, Alembic and USD are written without, and programs show flat faces.

Normals are off to the source where we do not read its values. Normals that are no average of those of the faces are
recomputed, and a line says so if they are off by more than 5 degrees (24_gpu_instancing, CesiumMilkTruck; not
MorphStressTest), also if they point into the faces (openusd_nestedInstancing, whose faces run the other way than
Alembic's). Vertices that a UV seam splits, and that share a normal in the source, share one in the result.
CesiumMan.usdz is 0.002 degrees off at rest; Blender itself shows the normals of such vertices up to 157 degrees apart
when its skeleton moves them.

From a glb, Blender takes only the normals at rest, not those of targets as three.js does, and turns them with the
triangles at each vertex of the file. They are therefore off, by many degrees for strong bends, in two cases: on faces
with more than three corners, which are triangles in the glb (arm, AnimCube, hypercube, lbs, deformingSubdTest,
vellum_balloon); and where UV seams or hard edges split a vertex, whose parts turn independently (cortex_vertexAnim:
without its UVs 0.02 degrees instead of 8.9; 03_skinned_cylinder, 24_animation_pointer, CesiumMan.glb,
SoC-ElephantWithMonochord). The largest angle can come from a few corners of triangles with almost no area (robot,
chicken_crossing). Materials and UV sets are counted as Blender shows them in the glb / as we read them.
"""

READABLE = (".abc", ".usd", ".usda", ".usdc", ".usdz", ".glb", ".gltf")

GLB_VARIANTS = {
    "plain": {},
    "--quantize": {"quantize": True},
    "--meshopt": {"meshopt": True},
    "both": {"quantize": True, "meshopt": True},
}

MEGABYTE = 1e6

MAX_FRAMES = 48
"""Largest number of frames per clip: with all frames, programs take hours to import the morph targets."""


def main(target: Path, chosen: Sequence[str]) -> None:
    """Measure the named sections, by default all; the page keeps the others unchanged."""
    data = Path(os.environ["PDECODEC_DATA"])
    kept = {}
    if target.exists():
        kept = {part.partition("\n")[0]: part for part in target.read_text(encoding="utf-8").split("\n## ")[1:]}
    for name, (title, measure) in SECTIONS.items():
        if not chosen or name in chosen:
            with tempfile.TemporaryDirectory() as folder:
                kept[title] = f"{title}\n\n" + "\n".join(measure(data, Path(folder)))
            whole = [kept[one] for one, _ in SECTIONS.values() if one in kept]
            target.write_text("\n## ".join([HEAD, *(part.rstrip() + "\n" for part in whole)]), encoding="utf-8")


def say(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr, flush=True)


def _as_array(sequence: MeshSequence) -> ArraySequence:
    clip = sequence.to_array()
    clip.metadata = {**clip.metadata, UP_AXIS: "Y", UNIT: "m"}
    return clip


def round_trips(data: Path, folder: Path) -> Iterator[str]:
    """Yield the lines of the table of scene files that are converted and back."""
    clips: dict[str, Expected] = {}
    read: dict[str, str] = {}
    for path in _scene_files(data):
        name = str(path.relative_to(data))
        say(name)
        try:
            with open_sequence(path) as sequence:
                if len(sequence.runs) > 1:
                    read[name] = f"{sequence.frame_count} frames in {len(sequence.runs)} runs"
                    continue
                some = FrameSelection(sequence, range(min(MAX_FRAMES, sequence.frame_count)))
                clip = _as_array(place(bake_transforms(some), up_axis="Y"))
        except PdecodecError as error:
            read[name] = error.message
            continue
        read[name] = f"{clip.frame_count} frames, {clip.vertex_count} vertices, {len(clip.objects)} objects"
        if clip.connectivity.face_count:
            clips[name] = expected_of(clip)
        else:
            read[name] += ", no faces"
    for number, (name, expected) in enumerate(clips.items()):
        say(f"writing {name}")
        for extension in ("abc", "usdc", "glb"):
            write_sequence(expected.sequence, folder / f"{number}.{extension}")
    shown = {
        (program, extension): _shown(program, extension, clips, folder)
        for program, extension in (
            ("Blender", "abc"),
            ("Blender", "usdc"),
            ("OpenUSD", "usdc"),
            ("Blender", "glb"),
            ("three.js", "glb"),
        )
    }
    jobs = [Job(data / name, expected.times, expected.sequence.fps) for name, expected in clips.items()]
    say(f"Blender: {len(jobs)} sources")
    sources = blender_shows(jobs, folder)
    for (program, extension), found in shown.items():
        if isinstance(found, str):
            yield f"{program} did not look at .{extension}: {found}.\n"
    heads = [f".{extension} in {program}" for program, extension in shown]
    yield _row(["file", "read", *heads, "materials", "UV sets"])
    yield _row(["---"] * (4 + len(heads)))
    numbers = {name: number for number, name in enumerate(clips)}
    for name, what in read.items():
        cells = [""] * (len(heads) + 2)
        if name in clips:
            seen = {key: None if isinstance(found, str) else found[numbers[name]] for key, found in shown.items()}
            source = None if isinstance(sources, str) else sources[numbers[name]]
            cells = ["–" if one is None else str(difference(one, clips[name], source)) for one in seen.values()]
            cells += _kept(clips[name], seen[("Blender", "glb")])
        yield _row([f"`{name}`", what, *cells])
    yield ""


def _scene_files(data: Path) -> list[Path]:
    found = [path for part in ("interop", "files") for path in sorted((data / part).rglob("*"))]
    return [path for path in found if path.suffix.lower() in READABLE]


def _shown(program: str, extension: str, clips: dict[str, Expected], folder: Path) -> list[Seen] | str:
    jobs = []
    for number, expected in enumerate(clips.values()):
        # Animations of glTF start at 0.
        start = float(expected.sequence.times[0]) if extension == "glb" else 0.0
        times = tuple(time - start for time in expected.times)
        jobs.append(Job(folder / f"{number}.{extension}", times, expected.sequence.fps))
    say(f"{program}: {len(jobs)} files .{extension}")
    if program == "OpenUSD":
        return openusd_shows(jobs)
    return blender_shows(jobs, folder) if program == "Blender" else three_shows(jobs, folder)


def _kept(expected: Expected, seen: Seen | None) -> list[str]:
    objects = expected.sequence.objects
    materials = {label for item in objects for label, members in face_sets(item, MATERIAL) if members.size}
    sets = max((len(uv_sets(item)) for item in objects), default=0)
    if seen is None or seen.failed:
        return ["–", "–"]
    return [f"{seen.materials}/{len(materials)}", f"{seen.uvs}/{sets}"]


def sizes(data: Path, folder: Path) -> Iterator[str]:
    """Yield the lines of the table of glb files of sequences."""
    clips = {}
    yield (
        "Sizes in MB: of the positions as float32, and of the glb as written by default, with `--quantize`, with "
        "`--meshopt` and with both. A plain one also holds float32 normals for each target: glTF has no "
        "smaller ones without KHR_mesh_quantization. Issues are errors and warnings of Khronos' validator, of the four "
        "in order. Then distances at frames / between frames, and Blender's normals, of the plain file.\n"
    )
    rows = {}
    for path in sorted((data / "sequences").glob("*.npz")):
        name = path.stem
        say(f"glb of {name}")
        with open_sequence(path) as sequence:
            some = FrameSelection(sequence, range(min(MAX_FRAMES, sequence.frame_count)))
            clip = _as_array(place(some, up_axis="Y"))
        clips[name] = expected_of(clip)
        cells = [f"{clip.points.nbytes / MEGABYTE:.2f}"]
        issues = []
        for variant, options in GLB_VARIANTS.items():
            file = folder / f"{len(rows)}{'' if variant == 'plain' else variant}.glb"
            write_sequence(clip, file, overwrite=True, **options)
            cells.append(f"{file.stat().st_size / MEGABYTE:.2f}")
            issues.append(_issues(file))
        rows[name] = [*cells, ", ".join(issues)]
    shown = {program: _shown(program, "glb", clips, folder) for program in ("Blender", "three.js")}
    yield _row(["sequence", "float32", *GLB_VARIANTS, "issues", *shown])
    yield _row(["---"] * (5 + len(GLB_VARIANTS)))
    for number, (name, cells) in enumerate(rows.items()):
        ends = [
            "–" if isinstance(found, str) else str(difference(found[number], clips[name])) for found in shown.values()
        ]
        yield _row([name, *cells, *ends])
    yield ""


def _issues(file: Path) -> str:
    try:
        found = gltf_issues(file)
    except pytest.skip.Exception:
        return "–"
    return str(found["numErrors"] + found["numWarnings"])


def exodus(data: Path, folder: Path) -> Iterator[str]:
    """Yield the lines of the table of Exodus files: their surface, or one line."""
    yield _row(["file", "vertices", "faces", "lines", "message"])
    yield _row(["---"] * 5)
    for path in sorted((data / "interop" / "exodus").iterdir()):
        try:
            with open_sequence(path) as sequence:
                whole = sequence.connectivity
                counts = [whole.vertex_count, whole.face_count, whole.line_count]
                yield _row([f"`{path.name}`", *map(str, counts), "; ".join(sequence.notices)])
        except PdecodecError as error:
            yield _row([f"`{path.name}`", "", "", "", error.message])
    yield ""


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


SECTIONS: dict[str, tuple[str, Callable[[Path, Path], Iterator[str]]]] = {
    "scenes": ("Scenes: distance at frames / between frames / normals", round_trips),
    "sequences": ("glTF of the shared sequences", sizes),
    "exodus": ("Exodus files", exodus),
}
"""Sections of the page by their names on the command line: title, and the function that measures it."""

if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
