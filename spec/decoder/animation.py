"""A whole file, decoded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spec.decoder.attributes import read_attributes
from spec.decoder.connectivity import read_faces_and_lines
from spec.decoder.fields import read_container, require
from spec.decoder.groups import read_groups, read_model
from spec.decoder.mesh import Mesh, read_description, read_json, read_vertex_counts
from spec.decoder.motion import Float32Array, Motion
from spec.decoder.patches import build_patches
from spec.decoder.reference import ReferenceFrame, read_reference
from spec.decoder.space import build_space


@dataclass
class Animation:
    """What a file holds."""

    meshes: list[Mesh]
    times: list[float]
    fps: float
    remarks: dict[str, Any]
    reference: ReferenceFrame
    motion: Motion

    def positions(self, time: float) -> Float32Array:
        """(vertices, 3) float32 [scene units] at a time [s]; vertices of all objects, one after the other."""
        return self.motion.positions(time)


def decode(data: bytes) -> Animation:
    """Decode the bytes of a file; CorruptFileError says what is wrong with it."""
    container = read_container(data)
    counts, conn = read_vertex_counts(container["CONN"])
    description = read_description(container["SEQN"], len(counts))
    meshes = [Mesh(name, vertices) for name, vertices in zip(description.names, counts, strict=True)]
    read_faces_and_lines(conn, container.sections.get("ORDR", b""), meshes)
    reference = read_reference(container["REST"], meshes)
    read_attributes(container.sections.get("ATTR", b""), meshes, reference.grid)
    model = read_model(container["MODL"])
    patches = build_patches(model.form.kind, meshes, reference.grid, model.form.points)
    space = build_space(model.form, model.masks, patches, reference.grid)
    chunks = [container[name] for name in ("TIME", "COEF", "CORR")]
    groups = read_groups(container["GRUP"], len(description.times), chunks)
    meta = container.sections.get("META", b"")
    remarks = read_json(meta) if meta else {}
    require(isinstance(remarks, dict), "META is not a JSON object")
    motion = Motion(description.times, groups, model, reference, space)
    return Animation(meshes, description.times, description.fps, remarks, reference, motion)


def decode_file(path: str | Path) -> Animation:
    """Decode a file."""
    return decode(Path(path).read_bytes())
