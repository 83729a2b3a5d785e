"""The command line; the package's docstring shows how to call it."""

from __future__ import annotations

import sys
from pathlib import Path

from spec.decoder.animation import decode_runs, run_at


def main(arguments: list[str]) -> None:
    if len(arguments) not in (1, 2):
        sys.exit("usage: python -m spec.decoder FILE.pdeanim [TIME]")
    runs = decode_runs(Path(arguments[0]).read_bytes())
    if len(arguments) == 2:
        time = float(arguments[1])
        for x, y, z in run_at(runs, time).positions(time):
            print(x, y, z)
        return
    for animation in runs:
        for mesh in animation.meshes:
            print(f"{mesh.name}: {mesh.vertices} vertices, {len(mesh.faces)} faces, {len(mesh.lines)} lines")
        first, last = animation.times[0], animation.times[-1]
        print(f"{len(animation.times)} frames from {first} s to {last} s, {animation.fps} a second")


if __name__ == "__main__":
    main(sys.argv[1:])
