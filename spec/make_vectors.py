"""Make the vectors of the specification: on purpose only (`make vectors`), never by a test.

    python -m spec.make_vectors             write vectors where none of those there would change
    python -m spec.make_vectors --replace   replace those that would

Accepted files pin down decoding. Encoders may go on to other bytes for the same input; nothing here has to
change then.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec import open_animation
from spec.accepted import accepted
from spec.refused import refused

FOLDER = Path(__file__).resolve().parent / "vectors"

BETWEEN = (0.01, 0.3, 0.5, 0.77, 0.995)
"""Times that positions are given at besides the frames, over the clip."""


def describe(data: bytes, path: Path) -> dict[str, Any]:
    """What the manifest says of an accepted file."""
    path.write_bytes(data)
    with open_animation(path) as animation:
        first, last = float(animation.times[0]), float(animation.times[-1])
        between = [first + (last - first) * share for share in BETWEEN]
        part = animation.connectivity
        return {
            "sha256": hashlib.sha256(data).hexdigest(),
            "objects": [item.name for item in animation.objects],
            "vertices": animation.vertex_count,
            "faces": part.face_count,
            "lines": part.line_count,
            "frames": animation.frame_count,
            "positions": digest(animation.sample(animation.times)),
            "between": between,
            "positions_between": digest(animation.sample(between)),
        }


def digest(points: NDArray[np.float32]) -> str:
    """SHA-256 of positions, float32, little-endian."""
    return hashlib.sha256(points.astype("<f4").tobytes()).hexdigest()


def main(arguments: list[str]) -> None:
    manifest: dict[str, dict[str, Any]] = {"accept": {}, "reject": {}}
    files: dict[Path, bytes] = {}
    with tempfile.TemporaryDirectory() as name:
        for vector, data in accepted(Path(name)):
            files[FOLDER / "accept" / f"{vector}.pdeanim"] = data
            manifest["accept"][vector] = describe(data, Path(name) / "c.pdeanim")
        for item in refused(Path(name)):
            files[FOLDER / "reject" / f"{item.name}.pdeanim"] = item.data
            manifest["reject"][item.name] = {
                "sha256": hashlib.sha256(item.data).hexdigest(),
                "error": item.error,
                "exit_code": 4,
                "reason": item.reason,
            }
    files[FOLDER / "manifest.json"] = (json.dumps(manifest, indent=1, ensure_ascii=False) + "\n").encode()
    different = [path for path, data in files.items() if path.exists() and path.read_bytes() != data]
    if different and "--replace" not in arguments:
        names = ", ".join(sorted(path.name for path in different))
        sys.exit(f"nothing is written: these vectors would change ({names}); --replace replaces them")
    for path, data in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    print(f"{len(files) - 1} vectors, {sum(map(len, files.values()))} bytes, {len(different)} replaced")


if __name__ == "__main__":
    main(sys.argv[1:])
