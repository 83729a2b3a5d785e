"""Readers and writers of mesh sequences, chosen by extension, magic bytes or frame pattern.

A new format is one module and one registration in :mod:`pdecodec.formats.catalogue`. Importing this package
loads none of them: a format's module, and what it depends on, loads when a file of that format is met, as
``write_onto`` does when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if __name__ != "pdecodec.formats":
    raise ImportError(f"import this package as pdecodec.formats, not as {__name__}")

from pdecodec.formats.base.registry import Format, list_formats, open_sequence, register_format, write_sequence
from pdecodec.formats.catalogue import BUILT_IN

if TYPE_CHECKING:
    from pdecodec.formats.base.onto import write_onto

for _entry in BUILT_IN:
    register_format(_entry)

__all__ = ["Format", "list_formats", "open_sequence", "register_format", "write_onto", "write_sequence"]


def __getattr__(name: str) -> Any:
    if name == "write_onto":
        from pdecodec.formats.base.onto import write_onto

        return write_onto
    raise AttributeError(f"module 'pdecodec.formats' has no attribute {name!r}")
