"""The bytes of an OBJ file, made ready for the kernels, and places in it told as line numbers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.decimal_text import ByteArray, Int64Array, float32_of_token, parse_decimals
from pdecodec.sequence import Float32Array

_CONTINUATION = re.compile(rb"\\[ \t]*\r?\n")
_TOKEN = re.compile(rb"[^ \t\r\n\v\f]*")
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"


@dataclass(frozen=True, eq=False)
class ObjText:
    """Text of one OBJ file that ends with a line feed and holds no line continuations.

    Parameters
    ----------
    path : pathlib.Path
    data : bytes
        The file with continuations and byte order mark blanked out, so that offsets stay those of the file.
    joined : tuple of int
        Offsets of the continuations, which were line breaks.
    """

    path: Path
    data: bytes
    joined: tuple[int, ...] = ()

    @cached_property
    def codes(self) -> ByteArray:
        """The same as a read-only uint8 array, for the kernels."""
        return np.frombuffer(self.data, np.uint8)

    def error(self, offset: int, message: str, *, frame: int | None = None) -> InputError:
        """An error at a byte of this file, which names the line."""
        line = 1 + self.data.count(b"\n", 0, offset) + sum(place < offset for place in self.joined)
        return InputError(f"line {line}: {message}", path=self.path, frame=frame)

    def token(self, offset: int) -> str:
        """The token that starts at a byte, shortened for messages."""
        return self.token_bytes(offset)[:40].decode("utf-8", "replace")

    def token_bytes(self, offset: int) -> bytes:
        """The token that starts at a byte."""
        match = _TOKEN.match(self.data, offset)
        return match[0] if match else b""

    def parse(self, starts: Int64Array, *, frame: int | None = None) -> Float32Array:
        """The numbers whose tokens start at given bytes.

        Parameters
        ----------
        starts : (...) int64
            Negative for none, which gives 0.

        Returns
        -------
        (...) float32

        Raises
        ------
        InputError
            If one is not a number.
        """
        places = starts.reshape(-1)
        numbers = np.empty(places.size, np.float32)
        certain = np.empty(places.size, np.bool_)
        parse_decimals(self.codes, places, numbers, certain)
        for index in np.flatnonzero(~certain).tolist():
            offset = int(places[index])
            token = self.token_bytes(offset)
            value = float32_of_token(token)
            if value is None:
                found = repr(self.token(offset)) if token else "the end of the line"
                raise self.error(offset, f"expected a number, found {found}; correct or export it again", frame=frame)
            numbers[index] = value
        return numbers.reshape(starts.shape)


def read_text(path: Path, *, frame: int | None = None) -> ObjText:
    """Read an OBJ file.

    Raises
    ------
    InputError
        If it cannot be read, is empty, or is not text.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}); check the file", path=path, frame=frame) from error
    if not data.strip():
        raise InputError("the file is empty; export it again", path=path, frame=frame)
    if b"\0" in data:
        raise InputError(
            "this is not OBJ text, it holds zero bytes; check the file",
            path=path,
            frame=frame,
            offset=data.index(b"\0"),
        )
    if data.startswith(_BYTE_ORDER_MARK):
        data = b" " * len(_BYTE_ORDER_MARK) + data[len(_BYTE_ORDER_MARK) :]
    joined: list[int] = []
    if b"\\" in data:
        data = _join_lines(data, joined)
    return ObjText(path, data if data.endswith(b"\n") else data + b"\n", tuple(joined))


def _join_lines(data: bytes, joined: list[int]) -> bytes:
    """Blank out continuations, except in comments, which may well end in a backslash (a path)."""
    text = bytearray(data)
    for match in _CONTINUATION.finditer(data):
        start_of_line = text.rfind(b"\n", 0, match.start()) + 1
        if not text[start_of_line : match.start()].lstrip().startswith(b"#"):
            text[match.start() : match.end()] = b" " * (match.end() - match.start())
            joined.append(match.start())
    return bytes(text)
