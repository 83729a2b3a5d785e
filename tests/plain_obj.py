"""OBJ read by a plain Python loop: what the fast reader is compared with, in values and in speed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray


def read_plainly(path: Path) -> tuple[NDArray[np.float32], list[list[int]], list[list[int]]]:
    """Positions (vertices, 3) float32, and the vertex indices of faces and of lines, from 0.

    Knows ``v``, ``f``, ``l`` and ``p``, comments, and indices that count back; no line continuations.
    """
    points: list[tuple[float, float, float]] = []
    faces: list[list[int]] = []
    lines: list[list[int]] = []
    with path.open(encoding="utf-8") as file:
        for line in file:
            words = line.split("#")[0].split()
            if not words:
                continue
            if words[0] == "v":
                points.append((float(words[1]), float(words[2]), float(words[3])))
            elif words[0] in ("f", "l", "p"):
                indices = [int(word.split("/")[0]) for word in words[1:]]
                indices = [index - 1 if index > 0 else len(points) + index for index in indices]
                if words[0] == "f":
                    faces.append(indices)
                elif words[0] == "l":
                    lines.append(indices)
                else:
                    lines.extend([index] for index in indices)
    return np.asarray(points, np.float64).astype(np.float32).reshape(-1, 3), faces, lines
