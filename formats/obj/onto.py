"""Write motion into an existing OBJ file: its text with other positions in the ``v`` lines and matching normals.

Comments, groups, materials, texture vertices, weights, colours and statements that are not read stay unchanged.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from pdecodec.errors import damaged
from pdecodec.formats.base.attribute_roles import vertex_slices
from pdecodec.formats.base.frame_files import find_frames
from pdecodec.formats.base.frame_writing import write_frames
from pdecodec.formats.base.normals import NormalRows, group_attribute, normal_rows
from pdecodec.formats.base.onto import Fitted
from pdecodec.formats.base.registry import Output
from pdecodec.formats.obj.text import ObjText, read_text
from pdecodec.formats.obj.writer import check_finite, frame_output, normals_text, rows_text, time_comment
from pdecodec.mesh.arrays import BoolArray, Float32Array
from pdecodec.mesh.sequence import MeshObject, MeshSequence

_LINE = re.compile(
    rb"^[ \t]*(?:(?P<v>v)[ \t]+\S+[ \t]+\S+[ \t]+\S+(?P<rest>[^\r\n]*)|(?P<vn>vn)[ \t][^\r\n]*|(?P<f>f)[ \t][^\r\n]*"
    rb"|mtllib[ \t]+(?P<library>[^\r\n]*?)[ \t]*|(?P<time># time )[^\r\n]*)(?:\r?\n)",
    re.MULTILINE,
)
"""Lines that change: vertices, normals, faces, the material library, and the time comment of our writer."""

_CORNER = re.compile(rb"(?<=[ \t])([-+\d]+/[-+\d]*/)([-+\d]+)|(?<=[ \t])[-+\d]+(?:/[-+\d]*)?(?=[ \t\r\n]|\Z)")
"""A corner of a face, with or without a normal."""


def write_obj_onto(
    sequence: MeshSequence, original: MeshSequence, fits: Sequence[Fitted], source: Path, output: Output
) -> tuple[str, ...]:
    """Write the original's first frame once per frame of a sequence, with the sequence's positions."""
    placed, new_folder = frame_output(output)
    text = _Template(
        read_text(find_frames(source, ".obj").paths[0], 0),
        original,
        fits,
        placed.path.parent,
        is_filled=output.is_filled,
    )

    def of_frame(points: Float32Array, frame: int) -> list[bytes]:
        check_finite(points, frame)
        return [time_comment(sequence.times[frame], output.rate), text.filled(points)]

    write_frames(sequence, placed, "OBJ", lambda _run, _first: of_frame, new_folder=new_folder)
    return ()


class _Template:
    """The text of an original, split into pieces that stay and slots for positions and normals."""

    def __init__(
        self, text: ObjText, original: MeshSequence, fits: Sequence[Fitted], folder: Path, *, is_filled: bool
    ) -> None:
        self._rest = original.read_frames(0, 1)[0]
        self._places = vertex_slices(original.objects)
        self._moves = [(one.own, self._places[one.index]) for one in fits]
        self._folder, self._source = folder, text.path
        self._end = b"\r\n" if b"\r\n" in text.data else b"\n"
        moved = np.zeros(len(self._rest), bool)
        for _, place in self._moves:
            moved[place] = True
        self._normals, corner_rows = _normals_of(
            # The original stores no usable normals if the sequence fills a carried scene: the attributes then tell
            # which corners share a normal.
            [one.item for one in sorted(fits, key=lambda one: one.index)] if is_filled else original.objects
        )
        self._pieces: list[bytes | tuple[int, list[bytes]] | None] = []
        self._fill(text.data, moved, corner_rows)

    def _fill(self, data: bytes, moved: BoolArray, corner_rows: Iterator[int] | None) -> None:
        """Split the text; a slot has its first vertex and the rest of each line, None is the slot of normals."""
        vertex = done = 0
        has_normals = False
        pieces = self._pieces
        for found in _LINE.finditer(data):
            kept = data[done : found.start()]
            done = found.end()
            line = found[0]
            if found["v"]:
                vertex += 1
                if vertex <= len(moved) and moved[vertex - 1]:
                    if not kept and pieces and isinstance(pieces[-1], tuple):
                        pieces[-1][1].append(found["rest"])
                    else:
                        pieces += [kept, (vertex - 1, [found["rest"]])]
                    continue
            elif found["vn"] and corner_rows is not None:
                pieces += [kept] if has_normals else [kept, None]
                has_normals = True
                continue
            elif found["f"] and corner_rows is not None:
                corners, mark, comment = line.partition(b"#")
                line = _CORNER.sub(partial(_with_normal, corner_rows), corners) + mark + comment
            elif found["library"]:
                line = b"mtllib " + self._library(found["library"]) + self._end
            elif found["time"]:
                line = b""
            pieces.append(kept + line)
        pieces.append(data[done:])
        if vertex != len(moved):
            raise damaged(f"{len(moved)} vertices were read, but {vertex} lines hold one", path=self._source)

    def _library(self, name: bytes) -> bytes:
        """Return the path of a material library relative to the folder of the output."""
        here = self._source.parent / os.fsdecode(name)
        if self._folder.resolve() == self._source.parent.resolve() or not here.is_file():
            return name
        return os.fsencode(os.path.relpath(here, self._folder.resolve()))

    def filled(self, points: Float32Array) -> bytes:
        """Return the text with positions (vertices, 3) of the sequence."""
        whole = self._rest.copy()
        for own, place in self._moves:
            whole[place] = points[own]
        return b"".join(self._text_of(piece, whole) for piece in self._pieces)

    def _text_of(self, piece: bytes | tuple[int, list[bytes]] | None, whole: Float32Array) -> bytes:
        if isinstance(piece, bytes):
            return piece
        if piece is None:
            parts = zip(self._normals, self._places, strict=True)
            lines = b"".join(normals_text(rows, whole[place]) for rows, place in parts if rows is not None)
            return lines.replace(b"\n", self._end)
        first, rests = piece
        lines = rows_text(whole[first : first + len(rests)], "v")
        if not any(rests):
            return lines.replace(b"\n", self._end)
        return b"".join(line + rest + self._end for line, rest in zip(lines.split(b"\n"), rests, strict=False))


def _normals_of(objects: Sequence[MeshObject]) -> tuple[list[NormalRows | None], Iterator[int] | None]:
    """Return the normal rows of each object, and the index of the ``vn`` line of each face corner."""
    found = [None if group_attribute(item) is None else normal_rows(item) for item in objects]
    if not any(found):
        return found, None
    lines: list[int] = []
    first = 1
    for item, rows in zip(objects, found, strict=True):
        if rows is None:
            lines += [0] * item.connectivity.face_indices.size
        else:
            lines += (rows.corner_rows + first).tolist()
            first += rows.count
    return found, iter(lines)


def _with_normal(rows: Iterator[int], corner: re.Match[bytes]) -> bytes:
    row = next(rows)
    return corner[0] if corner[1] is None else corner[1] + str(row).encode()
