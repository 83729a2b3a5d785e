"""The vectors whose coded streams hold random numbers, which no encoder writes and every decoder must follow."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np

from spec.accepted import Choices, clip, connectivity, encoded, sheet, two_sheets
from spec.decoder import contexts
from spec.decoder.animation import decode
from spec.decoder.contexts import Contexts
from spec.decoder.fields import CorruptFileError
from spec.decoder.groups import COSINES
from spec.decoder.rangecoder import RangeDecoder
from spec.sealing import (
    CHUNKS,
    Part,
    Row,
    ScriptedCoder,
    counted,
    numbers,
    seal,
    take_apart,
    text,
    with_first_group,
    with_section,
)

ATTEMPTS, MOST_BITS = 3000, 4000


class DrawingCoder(ScriptedCoder):
    """Replaces a range decoder: returns the bits of a script and then drawn ones, and encodes them. A bit is 1 with
    the probability of the first word of its name, else with that of its models.
    """

    def __init__(self, script: str, draw: random.Random, odds: Mapping[object, float]) -> None:
        super().__init__("")
        self._script, self._draw, self._odds, self._left = iter(script), draw, odds, MOST_BITS
        self.word: object = None

    def bit_with(self, probability: int) -> int:
        self._left -= 1
        odds = self._odds.get(self.word, probability / 65536) if self._left else -1.0
        if odds < 0:
            raise CorruptFileError("too many bits")
        self.bits = iter(next(self._script, "01"[self._draw.random() < odds]))
        return super().bit_with(probability)


@dataclass(frozen=True)
class Recipe:
    """What to draw: streams by section, each after a head and a script, in a file of these sections."""

    parts: list[Part]
    scripts: Mapping[str, str]
    heads: Mapping[str, bytes] = field(default_factory=dict)
    odds: Mapping[object, float] = field(default_factory=dict)

    def with_streams(self, streams: Mapping[str, bytes]) -> bytes:
        """Return the file with these streams."""
        parts = self.parts
        for kind, stream in streams.items():
            change = with_first_group if kind in CHUNKS else with_section
            parts = change(parts, kind, self.heads.get(kind, b"") + stream)
        return seal([part for part in parts if part.content or part.kind in CHUNKS])

    def draw(self, seed: int) -> bytes:
        """Return the first drawn file that the plain decoder reads."""
        draw = random.Random(seed)
        for _ in range(ATTEMPTS):
            coders = {
                f"drawn {kind}".encode(): DrawingCoder(bits, draw, self.odds) for kind, bits in self.scripts.items()
            }
            marked = self.with_streams({kind: f"drawn {kind}".encode() for kind in self.scripts})
            try:
                with replaced(coders):
                    decode(marked).motion.group(0)
            except CorruptFileError:
                continue
            return self.with_streams(
                dict(zip(self.scripts, (coder.to_bytes() for coder in coders.values()), strict=True))
            )
        raise AssertionError("no file among those drawn is valid")


@contextmanager
def replaced(coders: Mapping[bytes, DrawingCoder]) -> Iterator[None]:
    """Let coded streams of these bytes come from these coders, which are told the name of each bit."""

    def telling(read: Callable[..., int]) -> Callable[..., int]:
        def told(own: Contexts, *name: object, **options: object) -> int:
            if isinstance(own._coder, DrawingCoder):
                own._coder.word = name[0][0] if isinstance(name[0], tuple) else name[0]
            return read(own, *name, **options)

        return told

    of_name = {"bit": telling(Contexts.bit), "mixed": telling(Contexts.mixed)}
    with (
        patch.object(contexts, "RangeDecoder", lambda data: coders.get(data) or RangeDecoder(data)),
        patch.multiple(Contexts, **of_name),
    ):
        yield


def bare(vertices: int) -> list[Part]:
    """Return the sections of a file of one frame without functions of time: vertices without faces, empty chunks."""
    row = Row(1, 0, COSINES, struct.pack("<d", 1.0), (0, 0, 0))
    points = clip(np.zeros((1, vertices, 3)), connectivity(vertices))
    kept = [part for part in take_apart(encoded(points, Choices())) if part.kind not in ("META", *CHUNKS, "GRUP")]
    return [*kept, Part("GRUP", row.pack()), *(Part(kind, b"") for kind in (*CHUNKS, "ORDR", "SOLD", "ATTR"))]


def meshes() -> Iterator[tuple[str, Recipe]]:
    """Yield recipes of surfaces in any order, and of everything that is predicted on them."""
    odds = {"sign": 0.1, "is used": 0.3, "mask": 0.7, "distance": 0.3, "vertex": 0.3, "gap": 0.1, "place": 0.6}
    for name, faces, predictor, model in (
        ("triangles", numbers(9, 3) + "111", 15, b"\0\3\x10\0"),
        ("quads", numbers(6, 4) + "101", 6, b"\1\4\x08\0" + struct.pack("<d", 2.0) + b"\1"),
        ("polygons", numbers(4, 0, 17) + "111", 9, b"\0\1\x80\0"),
    ):
        rest = struct.pack("<4dB", 0.5, 0, 0, 0, predictor)
        heads = {"CONN": b"\1\x0e", "REST": rest, "MODL": model + struct.pack("<d", 1.0)}
        scripts = {"CONN": faces, "ORDR": "", "REST": "", "MODL": ""}
        yield f"drawn_{name}", Recipe(bare(14), scripts, heads, odds)
    yield "drawn_cells", Recipe(bare(14), {"SOLD": numbers(7)}, {}, {"new": 0.7})
    # Floats in two columns at corners, in the order of their first use, on grids of 1/100.
    uv = numbers(1) + text(b"uv") + numbers(2, 0, 3, 4, 0, 150, 0, 100, 0, 100)
    plain = take_apart(encoded(sheet(1), Choices()))
    yield "drawn_attributes", Recipe([*plain, Part("ATTR", b"")], {"ATTR": uv}, {}, {"complete": 0.1, "table": 0.2})


def groups() -> Iterator[tuple[str, Recipe]]:
    """Yield recipes of chunks of a group of frames."""
    parts = take_apart(encoded(two_sheets(), Choices(space=("patch", 8))))
    yield "drawn_coefficients", Recipe(parts, {"COEF": ""}, {}, {"size": 0.6})
    yield "drawn_functions_of_time", Recipe(parts, {"TIME": ""}, {"TIME": b"\0"}, {"rise": 0.8})
    yield "drawn_residuals", Recipe(parts, {"CORR": counted(4) + counted(1) + "1"}, {}, {"size": 0.9, "patch": 0.1})


def accepted_drawn() -> Iterator[tuple[str, bytes]]:
    """Yield the name and bytes of every drawn file."""
    for seed, (name, recipe) in enumerate((*meshes(), *groups())):
        yield name, recipe.draw(seed)
