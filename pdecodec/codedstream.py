"""A coded stream of numbers, texts and bytes, written and read by the same calls.

Every method takes what is to be coded and returns it; when decoding, what it is given does not matter, and it returns
what the bytes hold.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError, InputError
from pdecodec.kernels.numbers import NUMBER_CELLS, SIGNED_CELLS, code_number, code_signed
from pdecodec.kernels.rangecoder import (
    DECODE,
    ENCODE,
    EVEN,
    FIRST_BYTES,
    MODE,
    POSITION,
    finish,
    is_finished,
    new_coder,
    new_decoder,
)
from pdecodec.kernels.texts import END, TextModel, code_bytes, new_text_model

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

PIECE = 256
"""Bytes of a text that are decoded before memory for more is taken."""


@dataclass(frozen=True)
class Coding:
    """Where bits go to or come from: a coder's state and its bytes, see :mod:`pdecodec.kernels.rangecoder`."""

    coder: Int64Array
    data: UInt8Array

    @property
    def byte(self) -> int:
        """Where damage is noticed when decoding: the coder has looked at the bytes up to this one."""
        return min(int(self.coder[POSITION]), self.data.size)


def even_cells(count: int) -> Int64Array:
    """Adaptive bit models that have learnt nothing."""
    return np.full(count, EVEN, np.int64)


def equal_weights(sets: int, inputs: int) -> Int64Array:
    """(sets, inputs) int64 [1/65536]: weights that trust all inputs alike, together more than one."""
    return np.full((sets, inputs), 6 * 65536 // (5 * inputs), np.int64)


class CodedStream:
    """Numbers, texts and bytes, with what has been learnt of them.

    Parameters
    ----------
    coding : Coding
    section : str
        For messages.
    """

    def __init__(self, coding: Coding, section: str) -> None:
        self.coding = coding
        self.section = section
        self._cells: dict[Hashable, Int64Array] = {}
        self._texts: TextModel | None = None
        self._bytes: TextModel | None = None

    @classmethod
    def to_bytes(cls, section: str, write: Callable[[Self], None]) -> bytes:
        """What `write` codes; it is called again where its bytes did not fit."""
        capacity = 1 << 16
        while True:
            coding = Coding(new_coder(ENCODE), np.zeros(capacity, np.uint8))
            write(cls(coding, section))
            size = int(finish(coding.coder, coding.data))
            if size <= capacity:
                return coding.data[:size].tobytes()
            capacity = size

    @classmethod
    def of_bytes(cls, data: bytes, section: str) -> Self:
        """A stream that decodes `data`."""
        content = np.frombuffer(bytearray(data), np.uint8)
        return cls(Coding(new_decoder(content), content), section)

    @property
    def is_decoding(self) -> bool:
        return bool(self.coding.coder[MODE] == DECODE)

    def damaged(self, what: str) -> CorruptFileError:
        """An error for what does not fit."""
        return CorruptFileError(f"section {self.section} {what}, at its byte {self.coding.byte}")

    def check_not_ended(self) -> None:
        """Raise where decoding goes on although the bytes have long ended."""
        if self.is_decoding and self.coding.coder[POSITION] > self.coding.data.size + FIRST_BYTES:
            raise self.damaged("ends too early")

    def check_finished(self) -> None:
        """Raise unless the bytes end where what they hold does."""
        if not is_finished(self.coding.coder, self.coding.data):
            raise self.damaged("does not end where what it holds does")

    def number(self, field: Hashable, value: int) -> int:
        """A number from 0 to 2^32 - 2."""
        cells = self._cells.setdefault(field, even_cells(NUMBER_CELLS))
        return int(code_number(self.coding.coder, self.coding.data, cells, 0, value))

    def signed(self, field: Hashable, value: int) -> int:
        """A number of less than 2^32 in size."""
        cells = self._cells.setdefault(field, even_cells(SIGNED_CELLS))
        return int(code_signed(self.coding.coder, self.coding.data, cells, 0, value))

    def text(self, value: str, take: Callable[[int], object]) -> str:
        """A text.

        Parameters
        ----------
        value : str
        take : callable
            Called with the number of bytes before memory for them is taken, when decoding.
        """
        if self._texts is None:
            self._texts = new_text_model(is_primed=True)
        if not self.is_decoding:
            try:
                content = value.encode("utf-8")
            except UnicodeEncodeError as error:
                raise InputError(f"the name {value!r} is not text that UTF-8 can hold; rename it") from error
            self._code_bytes(self._texts, np.frombuffer(bytearray(content) + bytes([END]), np.uint8), True)
            return value
        pieces = []
        while True:
            take(PIECE)
            piece = np.zeros(PIECE, np.uint8)
            size = self._code_bytes(self._texts, piece, True)
            pieces.append(piece[:size].tobytes())
            if pieces[-1][-1] == END:
                break
        try:
            return b"".join(pieces)[:-1].decode("utf-8")
        except UnicodeDecodeError as error:
            raise self.damaged("holds a text that is not UTF-8") from error

    def bytes(self, values: UInt8Array) -> UInt8Array:
        """Bytes of a known number, (n,) uint8."""
        if self._bytes is None:
            self._bytes = new_text_model(is_primed=False)
        coded = values.copy()
        self._code_bytes(self._bytes, coded, False)
        return coded

    def _code_bytes(self, model: TextModel, values: UInt8Array, is_text: bool) -> int:
        size = int(code_bytes(self.coding.coder, self.coding.data, model, values, is_text))
        if size < 0:
            raise self.damaged("ends too early")
        return size
