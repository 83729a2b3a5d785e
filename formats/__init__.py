"""Readers and writers of mesh sequences, chosen by extension, magic bytes or frame pattern.

A new format is one module and one registration in :mod:`pdecodec.formats.catalogue`. Importing this package
loads none of them: a format's module, and what it depends on, loads when a file of that format is met.
"""

if __name__ != "pdecodec.formats":
    raise ImportError(f"import this package as pdecodec.formats, not as {__name__}")

from pdecodec.formats.catalogue import BUILT_IN
from pdecodec.formats.onto import write_onto
from pdecodec.formats.registry import Format, list_formats, open_sequence, register_format, write_sequence

for _entry in BUILT_IN:
    register_format(_entry)

__all__ = ["Format", "list_formats", "open_sequence", "register_format", "write_onto", "write_sequence"]
