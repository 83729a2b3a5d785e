"""The command line: see the package's docstring."""

from __future__ import annotations

import sys

from spec.decoder.animation import decode_file


def main(arguments: list[str]) -> None:
    if len(arguments) not in (1, 2):
        sys.exit("usage: python -m spec.decoder FILE.pdeanim [TIME]")
    animation = decode_file(arguments[0])
    if len(arguments) == 2:
        for x, y, z in animation.positions(float(arguments[1])):
            print(x, y, z)
        return
    for mesh in animation.meshes:
        print(f"{mesh.name}: {mesh.vertices} vertices, {len(mesh.faces)} faces, {len(mesh.lines)} lines")
    first, last = animation.times[0], animation.times[-1]
    print(f"{len(animation.times)} frames from {first} s to {last} s, {animation.fps} a second")


if __name__ == "__main__":
    main(sys.argv[1:])
