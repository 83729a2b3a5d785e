"""Read and write mesh sequences of other formats, chosen by extension, first bytes or frame pattern.

Begin with ``catalogue.py``, the list of formats, each with the functions that read and write it as dotted names. A
new format is one module and one entry there. ``base/`` has what families of formats share (registry, opening, frame
files, scenes, times, losses); ``obj/ gltf/ usd/ alembic/ vtk/ arrays/ caches/`` hold one family each, and import
from ``base/`` alone. Importing this package loads no family: its modules, and their dependencies, load when a file
of that family is opened or written, and the module of ``write_onto`` when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if __name__ != "pdecodec.formats":
    raise ImportError(f"import this package as pdecodec.formats, not as {__name__}")

from pdecodec.formats.base.opening import open_sequence, write_sequence
from pdecodec.formats.base.registry import Format, list_formats, register_format
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
