"""Read and write the fields of a section: little-endian numbers, counts, texts and byte strings with their length."""

from __future__ import annotations

import struct

from pdecodec.errors import CorruptFileError

LARGEST = 2**40
"""Largest magnitude of a quantised coefficient or residual."""

LARGEST_STEP = 2.0**160
"""Largest quantisation step. Float32 positions end at 2^128, so that products with the step stay far from overflow."""

COUNT_BITS = 63
"""Number of bits of the largest count, which takes nine bytes."""


def section_fault(section: str, message: str) -> CorruptFileError:
    """Return the error of a section that breaks the format."""
    return CorruptFileError(f"section {section} {message}", code="section-content", section=section)


class FieldWriter:
    """Collect the fields of one section."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def numbers(self, layout: str, *values: float) -> None:
        """Write little-endian numbers in :mod:`struct` notation."""
        self._parts.append(struct.pack("<" + layout, *values))

    def sized(self, data: bytes) -> None:
        """Write a byte string, preceded by its length (u64)."""
        self.numbers("Q", len(data))
        self._parts.append(data)

    def text(self, text: str) -> None:
        """Write a text as UTF-8, preceded by its length as a count."""
        data = text.encode()
        self.count(len(data))
        self._parts.append(data)

    def count(self, value: int) -> None:
        """Write an integer of 0 or more: 7 bits per byte, low bits first."""
        while value > 127:
            self.numbers("B", value & 127 | 128)
            value >>= 7
        self.numbers("B", value)

    def to_bytes(self) -> bytes:
        return b"".join(self._parts)


class FieldReader:
    """Read the fields that :class:`FieldWriter` wrote, never past the end.

    Parameters
    ----------
    data : bytes
    name : str
        The section's name, for messages.
    """

    def __init__(self, data: bytes, name: str) -> None:
        self._data = data
        self._name = name
        self._at = 0

    def take(self, size: int) -> bytes:
        """Read a number of bytes."""
        if size > len(self._data) - self._at:
            raise section_fault(self._name, f"ends after {len(self._data)} bytes, but {size} more are needed")
        piece = self._data[self._at : self._at + size]
        self._at += size
        return piece

    def integers(self, layout: str) -> tuple[int, ...]:
        """Read little-endian integers in :mod:`struct` notation."""
        return struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))

    def reals(self, layout: str) -> tuple[float, ...]:
        """Read little-endian floating-point numbers; NaN and infinity are refused."""
        values = struct.unpack("<" + layout, self.take(struct.calcsize("<" + layout)))
        if any(value - value != 0 for value in values):
            raise section_fault(self._name, "holds a number that is not finite")
        return values

    def sized(self) -> bytes:
        """Read a byte string, preceded by its length (u64)."""
        return self.take(self.integers("Q")[0])

    def count(self) -> int:
        """Read an integer of 0 or more, 7 bits per byte; CorruptFileError if it has more than 63 bits."""
        value = 0
        for shift in range(0, COUNT_BITS, 7):
            byte = self.take(1)[0]
            value |= (byte & 127) << shift
            if byte < 128:
                return value
        raise section_fault(self._name, f"holds a count of more than {COUNT_BITS} bits")

    def rest(self) -> bytes:
        """Read all remaining bytes."""
        return self.take(len(self._data) - self._at)

    def finish(self) -> None:
        """Raise CorruptFileError unless everything was read."""
        if self._at != len(self._data):
            raise section_fault(self._name, f"has {len(self._data) - self._at} bytes too many")
