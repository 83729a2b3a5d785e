"""pdecodec: a codec for deforming meshes.

The encoder fits the motion of a mesh sequence with closed-form solutions of a dynamic PDE (Fang et al. 2024,
Mathematics 12, 3175) or with simpler models, and writes a compact `.pdeanim` file; the decoder returns the mesh at
any time.

The public names are listed in `__init__.pyi`. Each is imported on first use, so that ``import pdecodec`` stays
light. Begin with `codec/encoding.py` (from a sequence to a file) and `codec/opening.py` (from a file to positions).
`mesh/` has mesh sequences, `codec/` the file format, `simulate/` scenes to try it on, `system/` files and threads.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

__version__ = "1.0.0"


def _check_interpreter() -> None:
    """Raise ImportError where the core would not be thread-safe: its objects rely on one interpreter lock per
    process.
    """
    if not getattr(sys, "_is_gil_enabled", lambda: True)():
        raise ImportError("pdecodec needs Python's global interpreter lock; set PYTHON_GIL=1, or use the usual build")
    for name in ("_interpreters", "_xxsubinterpreters"):  # the module's names from Python 3.13 on, and before 3.13
        try:
            interpreters = importlib.import_module(name)
        except ImportError:
            continue
        if interpreters.get_current() != interpreters.get_main():
            raise ImportError("pdecodec does not run in a subinterpreter; use threads or processes")
        return


_check_interpreter()

with open(f"{__file__.removesuffix('.py')}.pyi", encoding="utf-8") as _list:
    # "from MODULE import NAME_THERE as NAME"
    _lines = [line.split() for line in _list if line.startswith("from ")]
_HOMES = {words[5]: (words[1], words[3]) for words in _lines}
__all__ = [*sorted(_HOMES), "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'pdecodec' has no attribute {name!r}")
    module, name_there = _HOMES[name]
    return getattr(importlib.import_module(module), name_there)


def __dir__() -> list[str]:
    return __all__
