"""Prepare the text of an OBJ file for the core, which parses it, and parse the numbers that the core cannot."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pdecodec._core import ObjFault, ObjScan
from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.registry import read_errors
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.rounding import REPORTED_ROUNDING, largest_rounding

_CONTINUATION = re.compile(rb"\\[ \t]*\r?\n")
_TOKEN = re.compile(rb"[^ \t\r\n\v\f]*")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"

_VERTEX = re.compile(rb"^[ \t]*v[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.MULTILINE)

_PLAIN_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NOT_A_NUMBER = re.compile(rb"[+-]?(nan(\(.*\))?|1\.#(QNAN|SNAN|IND)0*)", re.IGNORECASE)
_INFINITY = re.compile(rb"([+-]?)(inf|infinity|1\.#INF0*)", re.IGNORECASE)

_MESSAGES = {
    ObjFault.BAD_INDEX: "expected a vertex index, found {token!r}; correct or export it again",
    ObjFault.ZERO_INDEX: "index 0 in {token!r}; OBJ counts from 1, or back from -1",
    ObjFault.INDEX_OUTSIDE: "{token!r} refers to a missing vertex, the file has {vertices}; export it again",
    ObjFault.TEXTURE_OUTSIDE: "{token!r} refers to a missing texture vertex, the file has {textures}; export it again",
    ObjFault.TOO_FEW_CORNERS: "{token!r} has too few vertices; "
    "a face has 3 or more, a line 2 or more, a point 1 or more",
    ObjFault.BAD_COORDINATES: "{token!r} has an unusual count of numbers; v takes 3, 4, 6 or 7, vt takes 1 to 3",
}


class NoVerticesError(InputError):
    """A file of readable text declares no vertices."""


def float32_of_token(token: bytes) -> np.float32 | None:
    """Return the float32 value of a token, or None if it is not a number.

    Accepts decimal notation, ``nan`` and ``inf`` in any case, and the ``1.#QNAN``, ``1.#IND`` and ``1.#INF`` of
    Microsoft's C library. Values beyond float32 become infinite.
    """
    if _PLAIN_NUMBER.fullmatch(token):
        with np.errstate(over="ignore", under="ignore"):
            return np.float32(float(token))
    if _NOT_A_NUMBER.fullmatch(token):
        return np.float32(np.nan)
    infinity = _INFINITY.fullmatch(token)
    if infinity:
        return np.float32(-np.inf if infinity[1] == b"-" else np.inf)
    return None


@dataclass(frozen=True, eq=False)
class ObjText:
    """Text of one OBJ file, ending with a line feed and without line continuations.

    Parameters
    ----------
    path : pathlib.Path
    frame : int
    data : bytes
        The file with continuations and byte order mark replaced by blanks, so that offsets stay valid.
    joined : tuple of int
        Offsets of the continuations, which were line breaks.
    """

    path: Path
    frame: int
    data: bytes
    joined: tuple[int, ...] = ()

    def error(self, offset: int, message: str) -> InputError:
        """Return an error at a byte of this file; its message names the line."""
        line = 1 + self.data.count(b"\n", 0, offset) + sum(place < offset for place in self.joined)
        return damaged(f"line {line}: {message}", path=self.path, frame=self.frame)

    def token(self, offset: int) -> str:
        """Return the token that starts at a byte, shortened for messages."""
        return self._token_bytes(offset)[:40].decode("utf-8", "replace")

    def line(self, offset: int) -> bytes:
        """Return the text from a byte to the end of its line."""
        return self.data[offset : self.data.index(b"\n", offset)]

    def _token_bytes(self, offset: int) -> bytes:
        match = _TOKEN.match(self.data, offset)
        return match[0] if match else b""

    def read_rest(self, unread: Int64Array, *arrays: Float32Array) -> None:
        """Parse the numbers that the core left unread.

        Parameters
        ----------
        unread : (n, 3) int64
            Index of the array, index of the value in it, and offset of the token.
        *arrays : float32 arrays
            Receive the values.

        Raises
        ------
        InputError
            If a token is not a number.
        """
        for array, place, offset in unread.tolist():
            token = self._token_bytes(offset)
            value = float32_of_token(token)
            if value is None:
                found = repr(self.token(offset)) if token else "the end of the line"
                raise self.error(offset, f"expected a number, found {found}; correct or export it again")
            arrays[array].reshape(-1)[place] = value


def is_rounding_noticeable(points: Float32Array) -> bool:
    """Return whether float32 moves positions (vertices, 3) by over :data:`REPORTED_ROUNDING` of the diagonal."""
    if not points.size or not np.isfinite(points).all():
        return False
    return math.sqrt(3) / 2 * float(np.spacing(np.abs(points).max())) > REPORTED_ROUNDING * frame_scale(points)


def rounding_of_text(text: ObjText, points: Float32Array) -> float:
    """Return the largest distance of positions (vertices, 3) that were read from a text from its exact numbers.

    If Python cannot parse the numbers, it is 0.
    """
    rows = _VERTEX.findall(text.data)
    try:
        numbers = np.array(rows).astype(np.float64)
    except ValueError:
        return 0.0
    if numbers.shape != points.shape:
        return 0.0
    return largest_rounding(restore_shortest_floats(numbers, points), points)


def restore_shortest_floats(numbers: Float64Array, rounded: Float32Array) -> Float64Array:
    """Return numbers read from a text; a number that is the shortest text of a float32 value becomes that value."""
    printed = rounded.astype(np.str_).astype(np.float64)
    return np.where(numbers == printed, rounded, numbers)


def read_text(path: Path, frame: int) -> ObjText:
    """Read an OBJ file; InputError if it cannot be read, is empty, or is not text."""
    with read_errors(path, frame=frame):
        data = path.read_bytes()
    if not data.strip():
        raise damaged("the file is empty; export it again", path=path, frame=frame)
    if b"\0" in data:
        message = "this is not OBJ text, it holds zero bytes; check the file"
        raise InputError(message, path=path, frame=frame, offset=data.index(b"\0"), code="damaged-input")
    if data.startswith(_BYTE_ORDER_MARK):
        data = b" " * len(_BYTE_ORDER_MARK) + data[len(_BYTE_ORDER_MARK) :]
    joined: list[int] = []
    if b"\\" in data:
        data = _join_lines(data, joined)
    return ObjText(path, frame, data if data.endswith(b"\n") else data + b"\n", tuple(joined))


def _join_lines(data: bytes, joined: list[int]) -> bytes:
    """Replace continuations by blanks, except in comments, which may end in a backslash (a path)."""
    text = bytearray(data)
    for match in _CONTINUATION.finditer(data):
        start_of_line = text.rfind(b"\n", 0, match.start()) + 1
        if not text[start_of_line : match.start()].lstrip().startswith(b"#"):
            text[match.start() : match.end()] = b" " * (match.end() - match.start())
            joined.append(match.start())
    return bytes(text)


def scan(text: ObjText) -> ObjScan:
    """Parse an OBJ file.

    Raises
    ------
    InputError
        With file and line, if a number, an index or a count is wrong, or there is no vertex.
    """
    found = ObjScan(text.data)
    if found.vertex_count == 0:
        message = "there are no vertices (v lines); is this an OBJ file?"
        raise NoVerticesError(message, path=text.path, frame=text.frame)
    if found.fault != ObjFault.NONE:
        counts = {"vertices": found.vertex_count, "textures": found.texture_count}
        message = _MESSAGES[found.fault].format(token=text.token(found.fault_byte), **counts)
        raise text.error(found.fault_byte, message)
    text.read_rest(found.unread, found.positions, found.vertex_extras, found.textures, found.normals)
    return found
