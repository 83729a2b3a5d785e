"""Compiled code that numba keeps on disk is forgotten when the sources it was made of have changed.

Numba compares a function's own file, and does not see that a function of another file, compiled into it, is another one
now. Stale code could then give wrong results, or never end.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

STAMP = "sources.sha256"
"""Beside the compiled code: digest of the sources that it was made of."""


def forget_stale_code(kernels: Path, dependents: tuple[Path, ...]) -> bool:
    """Remove compiled code where the kernels' sources are not those it was made of.

    Parameters
    ----------
    kernels : Path
        Folder of modules that are compiled into each other.
    dependents : tuple of Path
        Folders of modules that compile these into their own.

    Returns
    -------
    bool
        Whether the code that is there, if any, was made of these sources already.
    """
    digest = hashlib.sha256()
    for path in sorted(kernels.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    stamp = kernels / "__pycache__" / STAMP
    with contextlib.suppress(OSError, UnicodeDecodeError):
        if stamp.read_text(encoding="ascii") == digest.hexdigest():
            return True
    with contextlib.suppress(OSError):  # Where nothing can be written, numba keeps compiled code elsewhere.
        for folder in (kernels, *dependents):
            # An index gone, numba compiles anew and overwrites the rest.
            for index in folder.glob("__pycache__/*.nbi"):
                with contextlib.suppress(FileNotFoundError):
                    index.unlink()
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest.hexdigest(), encoding="ascii")
    return False
