"""A page that plays `.pdeanim` files offline: it contains scripts, the decoder and the files."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.decoder import Animation
from pdecodec.errors import InputError
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.player import FOLDER

SCRIPTS = (
    "pdeanim.js",
    "core.js",
    "errors.js",
    "source.js",
    "fields.js",
    "mesh.js",
    "motion.js",
    "gpu-shaders.js",
    "gpu.js",
)
"""Scripts of the player that the page needs."""

MAX_STEPS = 32767
"""Largest difference from an original, in steps, that 16 bits hold; half a step is then 1.5e-5 of that difference."""

TIME_TOLERANCE = 1e-6
"""Largest difference [s] between times of an original and of the file."""


@dataclass(frozen=True)
class Original:
    """The original of a file, as differences from the decoded positions.

    Attributes
    ----------
    name : str
    step : float
        Size of a step [scene units].
    differences : bytes
        int16 in steps, (frames, vertices, 3), little-endian, compressed by gzip.
    fields : mapping of str to (float, bytes or None)
        For each field that both have: size of a step, and differences (frames, rows, components) as above; None if all
        values are equal.
    """

    name: str
    step: float
    differences: bytes
    fields: Mapping[str, tuple[float, bytes | None]]


def difference(animation: Animation, original: MeshSequence, name: str) -> Original:
    """Return the difference of an original from the decoded positions, at every frame and vertex.

    Raises
    ------
    InputError
        If the two have different frames or vertices.
    """
    for what, own, other in (
        ("runs of frames", len(animation.runs), len(original.runs)),
        ("frames", animation.frame_count, original.frame_count),
        ("vertices", animation.most_vertices, original.most_vertices),
    ):
        if own != other:
            raise InputError(
                f"has {other} {what}, the .pdeanim file {own}; give the sequence it was made from",
                code="object-mismatch",
                path=name,
            )
    if not np.allclose(animation.times - animation.times[0], original.times - original.times[0], atol=TIME_TOLERANCE):
        raise InputError("has its frames at other times than the .pdeanim file", code="object-mismatch", path=name)
    step, differences = _in_steps(
        _apart(points, animation.read_frames(start, start + len(points))) for start, points in original.blocks()
    )
    fields: dict[str, tuple[float, bytes | None]] = {}
    for field in animation.fields if len(animation.runs) == 1 else ():
        if any(_rows(one, original) == _rows(field, animation) for one in original.fields):
            size, apart = _in_steps(
                _apart(values, animation.read_field(field.name, start, start + len(values)))
                for start, values in original.field_blocks(field.name)
            )
            fields[field.name] = size, apart if size else None
    return Original(name, step or 1.0, differences, fields)


def _rows(field: Field, sequence: MeshSequence) -> tuple[str, str, int, list[int]]:
    return field.name, field.domain, field.components, field.row_counts(sequence.objects)


def _apart(own: NDArray[Any], decoded: NDArray[Any]) -> Float32Array:
    """Return differences; 0 where a value is not finite."""
    with np.errstate(invalid="ignore"):
        apart = own.astype(np.float64) - decoded
    return np.where(np.isfinite(apart), apart, 0).astype(np.float32)


def _in_steps(parts: Iterable[Float32Array]) -> tuple[float, bytes]:
    """Return the size of a step, 0 if all differences are 0, and the differences in steps, compressed."""
    found = np.concatenate(list(parts))
    step = float(np.abs(found).max(initial=0.0)) / MAX_STEPS
    steps = np.rint(found / (step or 1.0)).astype("<i2")
    return step, gzip.compress(steps.tobytes(), mtime=0)


def view_page(
    title: str, clips: Sequence[tuple[str, bytes]], *, original: Original | None = None, up_axis: str | None = None
) -> str:
    """Return the page as HTML.

    Parameters
    ----------
    title : str
    clips : sequence of (name, bytes of a .pdeanim file)
        One, or two to compare.
    original : Original, optional
        The original of the first clip.
    up_axis : {"y", "z"}, optional
        The axis that points up in the picture; y by default.
    """
    files = [{"name": name, "data": _in_base64(data)} for name, data in clips]
    return _page(title, {"clips": files, **_of_original(original)}, up_axis, wasm=_packed_wasm())


def served_page(title: str, name: str, address: str, *, up_axis: str | None = None) -> str:
    """Return the page for one file that it fetches from an address of its server."""
    return _page(title, {"clips": [{"name": name, "address": address}]}, up_axis, wasm=_packed_wasm())


def list_page(title: str, files: Sequence[tuple[str, int, str]]) -> str:
    """Return a page that lists files. Each has a name, a size [bytes] and an address below ``/file/`` and
    ``/view/``.
    """
    rows = [{"name": name, "size": size, "address": address} for name, size, address in files]
    return _page(title, {"files": rows}, None, wasm=_packed_wasm(), template="list.html")


def _of_original(original: Original | None) -> dict[str, Any]:
    if original is None:
        return {}
    fields = [
        {"name": name, "step": step, "data": data and _in_base64(data)}
        for name, (step, data) in original.fields.items()
    ]
    data = _in_base64(original.differences)
    return {"original": {"name": original.name, "step": original.step, "data": data, "fields": fields}}


def _in_base64(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")


def _packed_wasm() -> str:
    return _in_base64(gzip.compress((FOLDER / "pdeanim.wasm").read_bytes(), 9, mtime=0))


def _page(title: str, data: Mapping[str, Any], up_axis: str | None, *, wasm: str, template: str = "index.html") -> str:
    folder = FOLDER / "view"
    content = {**data, "wasm": wasm, "up": 2 if up_axis == "z" else 1}
    values = {
        "TITLE": escape(title),
        "STYLE": (folder / "style.css").read_text("utf-8"),
        "IMPORTS": json.dumps({"imports": _imports(folder)}),
        "DATA": _in_script(json.dumps(content)),
    }
    text = (folder / template).read_text("utf-8")
    return re.sub("TITLE|STYLE|IMPORTS|DATA", lambda found: values[found[0]], text)


def _in_script(text: str) -> str:
    """Return JSON that cannot end a script, whatever names it contains."""
    return text.replace("<", "\\u003c")


def _imports(folder: Path) -> dict[str, str]:
    """Return the scripts of the page as data addresses, by the names under which other scripts import them."""
    files = {f"pdeanim/{name}": FOLDER / name for name in SCRIPTS}
    files |= {f"pdeanim/view/{path.name}": path for path in sorted(folder.glob("*.js"))}
    found = {}
    for name, path in files.items():
        # A data address has no folder, so relative imports are replaced by names.
        text = re.sub(r'from "\./([\w-]+\.js)"', r'from "pdeanim/\1"', path.read_text("utf-8"))
        found[name] = "data:text/javascript;base64," + _in_base64(text.encode())
    return {"pdeanim": found["pdeanim/pdeanim.js"], **found}
