"""Decode whole files. Also sections 4 and 18 of the specification: SEQN and META."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from spec.decoder.attributes import read_attributes
from spec.decoder.cells import divide_cells, predicted_on, read_cells
from spec.decoder.connectivity import read_faces_and_lines
from spec.decoder.contexts import PRIMER, ByteModel, Contexts
from spec.decoder.fields import CorruptFileError, Fields, decompress, read_container, read_runs, require
from spec.decoder.groups import read_groups, read_model
from spec.decoder.mesh import Mesh, read_vertex_counts
from spec.decoder.motion import Float32Array, Motion
from spec.decoder.patches import build_patches
from spec.decoder.reference import ReferenceFrame, read_reference
from spec.decoder.scene import Scene, read_scene
from spec.decoder.space import build_space
from spec.decoder.storedfields import (
    COPY,
    DISPLACEMENT,
    MAGNITUDE,
    VELOCITY,
    StoredField,
    Value,
    divide_runs,
    read_fields,
    value_at,
)

LISTED = 2


@dataclass
class Animation:
    """Everything that a file (or one run of it) holds."""

    meshes: list[Mesh]
    times: list[float]
    jumps: list[int]
    fps: float
    remarks: dict[str, Any]
    reference: ReferenceFrame
    motion: Motion
    fields: list[StoredField]
    scene: Scene | None = None

    def positions(self, time: float) -> Float32Array:
        """Return (vertices, 3) float32 positions [scene units] at a time [s]; vertices of all objects in one row."""
        return self.motion.positions(time)

    def field(self, index: int, time: float) -> list[Value]:
        """Return the values of a field at a time [s], row after row."""
        return value_at(self.fields[index], self.times, self.jumps, time)

    def depends_on_motion(self, index: int) -> bool:
        """Return whether decoders may compute some values of a field with other arithmetic, because they follow
        from positions.
        """
        own = self.fields[index].computed
        sources = (self.fields[group.source].computed for group in own if group.code in (COPY, MAGNITUDE))
        return any(group.code in (VELOCITY, DISPLACEMENT) for groups in (own, *sources) for group in groups)


def decode(data: bytes) -> Animation:
    """Decode the bytes of a file of one run; raise CorruptFileError if they break the specification."""
    runs = decode_runs(data)
    if len(runs) > 1:
        raise ValueError(f"the file has {len(runs)} runs of frames; decode_runs gives them")
    return runs[0]


def decode_runs(data: bytes) -> list[Animation]:
    """Decode the bytes of a file, run by run (2.3); raise CorruptFileError if they break the specification."""
    sections = read_container(data)
    fps, frames, times, jumps, coded = read_sequence(sections["SEQN"])
    scene = read_scene(sections["SCEN"])
    if "RUNS" not in sections:
        require(len(frames) == 1, "several runs of frames without RUNS")
        found = [decode_run(sections, fps, times, jumps, coded)]
        found[0].scene = scene
        return found
    read_names(coded, 0)
    runs, found, end = read_runs(sections["RUNS"], sections["RDAT"], len(frames)), [], 0
    cells = divide_cells(sections["SOLD"], len(runs)) if sections["SOLD"] else [b""] * len(runs)
    of_fields = [(b"", b"")] * len(runs)
    if "RFLD" in sections:
        require(sections["FLDS"] and "FDAT" in sections, "RFLD without FLDS and FDAT")
        of_fields = divide_runs(sections["RFLD"], sections["FLDS"], sections["FDAT"], len(runs))
    for run, count, (headers, chunks), solids in zip(runs, frames, of_fields, cells, strict=True):
        end += count
        names = Contexts(run.sections["NAME"])
        begin, inside = end - count, [jump - (end - count) for jump in jumps if end - count < jump < end]
        known = run.sections | {"META": sections["META"], "FLDS": headers, "FDAT": chunks, "SOLD": solids}
        own = decode_run(known, fps, times[begin:end], inside, names)
        require(sum(mesh.vertices for mesh in own.meshes) == run.vertices, "another number of vertices than in RUNS")
        found.append(own)
    found[0].scene = scene
    return found


def decode_run(
    sections: dict[str, bytes], fps: float, times: list[float], jumps: list[int], coded: Contexts
) -> Animation:
    """Decode one run from its sections; `coded` is the stream from which the objects' names are read next."""
    counts, conn = read_vertex_counts(sections["CONN"])
    meshes = [Mesh(name, vertices) for name, vertices in zip(read_names(coded, len(counts)), counts, strict=True)]
    read_faces_and_lines(conn, sections["ORDR"], meshes)
    read_cells(sections["SOLD"], meshes)
    whole = predicted_on(meshes)
    reference = read_reference(sections["REST"], whole)
    read_attributes(sections["ATTR"], meshes, reference.grid)
    model = read_model(sections["MODL"])
    patches = build_patches(model, whole, reference)
    space = build_space(model, patches, reference.grid)
    groups = read_groups(sections["GRUP"], len(times), [sections[name] for name in ("TIME", "COEF", "CORR")])
    remarks = read_remarks(sections["META"])
    motion = Motion(times, jumps, groups, model, reference, space)
    fields = read_fields(sections["FLDS"], sections.get("FDAT"), meshes, len(times), motion)
    return Animation(meshes, times, jumps, fps, remarks, reference, motion, fields)


def decode_file(path: str | Path) -> Animation:
    """Decode a file of one run, given its path."""
    return decode(Path(path).read_bytes())


def run_at(runs: list[Animation], time: float) -> Animation:
    """Return the run that is shown at a time [s] (2.3)."""
    return next((run for run in reversed(runs) if run.times[0] <= time), runs[0])


def read_names(coded: Contexts, objects: int) -> list[str]:
    """Section 4: read the names of `objects` objects, which end the coded stream."""
    texts = ByteModel(coded, "texts", primer=PRIMER)
    names = [texts.read_text() for _ in range(objects)]
    coded.finish()
    return names


def read_sequence(data: bytes) -> tuple[float, list[int], list[float], list[int], Contexts]:
    """Section 4: read the frame rate, frames per run, times, discontinuities, and the coded stream at the names."""
    fields = Fields(data)
    runs = [fields.count() for _ in range(fields.count())]
    frames, flags = sum(runs), fields.u8()
    require(runs and min(runs) >= 1, "no frames")
    rule, at_frame_rate, whole_fps, whole_start, has_jumps = flags & ~60, flags & 4, flags & 8, flags & 16, flags & 32
    require(rule < 4 and not (rule == LISTED and flags & 20), "an unknown rule for times")

    def real(is_whole: int) -> float:
        value = fields.count() if is_whole else fields.f64()
        require(value <= 2**53 or not is_whole, "a whole number out of range")
        return float(value)

    fps = real(whole_fps)
    require(fps > 0, "a frame rate that is not above 0")
    times = []
    if rule != LISTED:
        start = real(whole_start)
        rate = fps if at_frame_rate else fields.f64()
        require(rate > 0, "a rate of times that is not above 0")
        rules = {0: lambda i: start + i / rate, 1: lambda i: (start + i) / rate, 3: lambda i: start + i * (1 / rate)}
        times = [rules[rule](i) for i in range(frames)]
    jumps = read_jumps(fields, frames) if has_jumps else []
    contexts = Contexts(fields.rest())
    if rule == LISTED:
        times = decode_times(ByteModel(contexts, "bytes").read_bytes(8 * frames), frames)
    require(all(abs(time) <= 2.0**53 for time in times), "a time is out of range")
    require(all(b - a >= 2.0**-53 for a, b in pairwise(times)), "times do not increase")
    return fps, runs, times, jumps, contexts


def read_jumps(fields: Fields, frames: int) -> list[int]:
    """Section 4: read the frames at which discontinuities ("jumps") are."""
    count = fields.count()
    require(1 <= count < frames, "no jumps, or more than there can be")
    jumps = [0]
    for _ in range(count):
        jumps.append(jumps[-1] + fields.count())
        require(jumps[-2] < jumps[-1] < frames, "a discontinuity outside the frames")
    return jumps[1:]


def decode_times(planes: bytes, frames: int) -> list[float]:
    """Section 4, rule 2: decode times from byte planes."""
    times = []
    place = step = 0
    for i in range(frames):
        n = int.from_bytes(planes[i::frames], "little")
        step += -(n + 1) // 2 if n % 2 else n // 2
        place = (place + step) % 2**64
        inverted = place ^ 2**63 - 1 if place >> 63 else place
        times.append(struct.unpack("<d", inverted.to_bytes(8, "little"))[0])
    return times


def read_remarks(stream: bytes) -> dict[str, Any]:
    """Section 18: read META."""
    try:
        remarks = json.loads(decompress(stream, 2**24).decode()) if stream else {}
    except (ValueError, RecursionError):
        raise CorruptFileError("META is not JSON") from None
    require(isinstance(remarks, dict), "META is not a JSON object")
    check_value(remarks, 1)
    return dict(remarks)


def is_finite(number: float) -> bool:
    """Return whether a number, rounded to float64, is finite."""
    try:
        return math.isfinite(number)
    except OverflowError:
        return False


def check_value(value: object, depth: int) -> None:
    """Section 18: check a value of META and everything nested in it."""
    require(depth <= 32, "META is nested too deep")
    if isinstance(value, str):
        require(not any("\ud800" <= letter <= "\udfff" for letter in value), "META holds half a character")
    elif isinstance(value, int | float):
        require(is_finite(value), "META holds a number that is not finite")
    elif isinstance(value, dict):
        for member in (*value, *value.values()):
            check_value(member, depth + 1)
    elif isinstance(value, list):
        for member in value:
            check_value(member, depth + 1)
