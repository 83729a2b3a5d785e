"""Files with sections that a test codes itself, to test how the library decodes them."""

from __future__ import annotations

import struct
import zlib
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pdecodec import ArrayEvaluator, ArraySequence, Connectivity, MeshObject, encode, open_animation
from pdecodec.codec.sections.description import encode_sequence_description
from spec.decoder.groups import SHAPES, TRAJECTORIES
from spec.sealing import Part, Row, seal, take_apart

PLENTY = 2**52
"""Memory limit [bytes] too large for any test to reach."""


@cache
def _still_file(objects: int) -> list[Part]:
    """Return the sections of a file of one frame and `objects` unnamed objects of one vertex."""
    items = [MeshObject("", Connectivity(1)) for _ in range(objects)]
    data = encode(ArraySequence(np.zeros((1, objects, 3)), objects=items), effort="fast").data
    assert data is not None
    return take_apart(data)


def file_of(objects: int, **sections: bytes) -> bytes:
    """Return a file of one frame and `objects` single vertices, with some sections replaced.

    It has no functions of time, so its groups of frames fit any mesh.
    """
    left = dict(sections)
    parts = [Part(part.kind, left.pop(part.kind, part.content), part.flags) for part in _still_file(objects)]
    return seal([*parts, *(Part(kind, content) for kind, content in left.items() if content)])


def evaluator_of(
    times: NDArray[np.float64], functions: int, chunk: bytes, *, axes: int, step: float = 1.0
) -> ArrayEvaluator:
    """Return the evaluator of one still vertex whose frames, at these times, form a group with these functions of time.

    Parameters
    ----------
    times : (frames,) float64 [s]
    functions : int
    chunk : bytes
        Chunk of section TIME: the coded functions.
    axes : {1, 3}
        Number of values of a function at a frame.
    step : float
        Quantisation step of the functions.
    """
    clip = ArraySequence(np.zeros((times.size, 1, 3)), times=times, fps=24.0)
    sizes, kind = (len(chunk), 0, 0), TRAJECTORIES if axes == 3 else SHAPES
    group = Row(times.size, functions, kind, struct.pack("<dd", 1.0, step), sizes, zlib.crc32(chunk)).pack()
    file = file_of(1, SEQN=encode_sequence_description(clip), GRUP=group, TIME=chunk, COEF=b"", CORR=b"")
    return ArrayEvaluator(open_animation(file), np)
