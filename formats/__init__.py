"""Readers and writers of mesh sequences, chosen by extension, magic bytes or frame pattern.

A new format is one module and one registration in :mod:`pdecodec.formats.catalogue`. Importing this package
loads none of them: a format's module, and what it depends on, loads when a file of that format is met.
"""

if __name__ != "pdecodec.formats":
    raise ImportError(f"import this package as pdecodec.formats, not as {__name__}")

from pdecodec.formats.catalogue import register_built_in_formats
from pdecodec.formats.registry import Format, list_formats, open_sequence, register_format, write_sequence

register_built_in_formats()

__all__ = ["Format", "list_formats", "open_sequence", "register_format", "write_sequence"]
