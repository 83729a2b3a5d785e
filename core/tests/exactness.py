"""Compare the data that builds of the core by different compilers decode: `make exactness`.

    python -m core.tests.exactness [BUILD ...]

Each build decodes every vector of the specification. Exact data (bits and their probabilities, connectivity,
integers, attributes, times, errors) must be the same in all builds and in the manifest; positions must agree within
the margin. Builds for other systems also run the programs that misuse the C interface, damage files and share them by
threads, without sanitizers.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spec.vector_files import accepted_files, read_manifest, write_vectors

ROOT = Path(__file__).resolve().parents[2]

REMARKS = ("(3.2)", "(18)")
"""The specification's sections on remarks, which the core does not decode."""

FILES_PER_CALL = 150
"""Windows takes command lines of at most 32,767 characters."""


@dataclass(frozen=True)
class Build:
    """How to compile the core: a compiler with its options, and the command that runs the programs.

    Where `target` names a processor and system, the compiler is Zig's. `runs` is false for a system that no emulator
    runs here: such a build shows only that the core compiles and links.
    """

    name: str
    compiler: str
    flags: str
    contract: str = "off"
    runner: tuple[str, ...] = ()
    static: bool = False
    target: str = ""
    runs: bool = True

    @property
    def missing(self) -> list[str]:
        zig = ["ziglang"] if self.target and importlib.util.find_spec("ziglang") is None else []
        programs = (*(() if self.target else (self.compiler,)), *self.runner[:1], "cmake")
        return [*zig, *(program for program in programs if shutil.which(program) is None)]

    @property
    def system(self) -> str:
        """The system as CMake calls it, or nothing for this machine's."""
        names = {"windows": "Windows", "macos": "Darwin", "linux": "Linux"}
        return next((names[part] for part in self.target.split("-") if part in names), "")

    @property
    def suffix(self) -> str:
        return ".exe" if self.system == "Windows" else ""


CLANG_NAMES = ("clang++", *(f"clang++-{version}" for version in range(25, 13, -1)))

CLANG = next(filter(shutil.which, CLANG_NAMES), CLANG_NAMES[0])

AARCH64: dict[str, Any] = {"compiler": "aarch64-linux-gnu-g++", "runner": ("qemu-aarch64",), "static": True}

ZIG: dict[str, Any] = {"compiler": "zig", "flags": "-O2"}

WINE = next(filter(shutil.which, ("wine64", "wine", "/usr/lib/wine/wine64")), "wine64")

BUILDS = (
    Build("gcc-O3-fused", "g++", "-O3 -mfma", "fast"),
    Build("gcc-O3", "g++", "-O3"),
    Build("gcc-O0", "g++", "-O0"),
    Build("clang-O3", CLANG, "-O3"),
    Build("clang-O0", CLANG, "-O0"),
    Build("clang-O3-fused", CLANG, "-O3 -mfma", "fast"),
    Build("arm64-O3", **AARCH64, flags="-O3"),
    Build("arm64-O0", **AARCH64, flags="-O0"),
    Build("arm64-O3-fused", **AARCH64, flags="-O3", contract="fast"),
    Build("windows-x86-64", **ZIG, target="x86_64-windows-gnu", runner=(WINE,)),
    Build("linux-arm64-musl", **ZIG, target="aarch64-linux-musl", runner=("qemu-aarch64",)),
    Build("macos-arm64", **ZIG, target="aarch64-macos", runs=False),
    Build("macos-x86-64", **ZIG, target="x86_64-macos", runs=False),
)
"""All builds; the first one differs most from the installed one."""


def decoded(build: Build) -> Path:
    """Compile a build, let it decode all vectors if it runs here, and return the folder of its results."""
    folder = ROOT / "build" / "exactness" / build.name
    options = {
        "CMAKE_CXX_COMPILER": build.compiler,
        "CMAKE_C_FLAGS": build.flags,
        "CMAKE_CXX_FLAGS": build.flags,
        "CMAKE_BUILD_TYPE": "None",
        "CMAKE_EXE_LINKER_FLAGS": "-static" if build.static else "",
        "PDEANIM_CONTRACT": build.contract,
        "PDEANIM_LIBRARY": "OFF",
    }
    if build.target:
        options |= {"CMAKE_SYSTEM_NAME": build.system, **zig_programs(folder, build.target)}
        test_interface(build, options)
    compile_core(folder, options | {"PDEANIM_EXACTNESS": "ON"}, "exactness")
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    if not build.runs:
        return out
    files = [*accepted_files().values(), *write_vectors(folder / "refused", "reject").values()]
    for start in range(0, len(files), FILES_PER_CALL):
        run(*build.runner, folder / f"exactness{build.suffix}", out, *files[start : start + FILES_PER_CALL])
    return out


def test_interface(build: Build, options: dict[str, str]) -> None:
    """Compile the programs that test the C interface, and run them over the vectors if the build runs here."""
    folder = ROOT / "build" / "exactness" / build.name / "interface"
    vectors = accepted_files()
    files: dict[str, list[str | Path]] = {
        "misuse": [vectors[name] for name in ("polygons_attributes", "runs", "fields")],
        "mutants": ["2000", *vectors.values()],
        "races": ["300", *(vectors[name] for name in ("groups", "polygons_attributes", "raw_vertices", "runs"))],
    }
    compile_core(folder, options | {"PDEANIM_SANITIZE": "ON", "PDEANIM_SANITIZERS": ""}, *files)
    for program, arguments in files.items() if build.runs else ():
        run(*build.runner, folder / f"{program}{build.suffix}", *arguments)


def compile_core(folder: Path, options: dict[str, str], *targets: str) -> None:
    run("cmake", "-S", ROOT / "core", "-B", folder, *(f"-D{name}={value}" for name, value in options.items()))
    run("cmake", "--build", folder, "--parallel", str(os.cpu_count()), "--target", *targets)


def zig_programs(folder: Path, target: str) -> dict[str, str]:
    """Write scripts that run Zig's compiler and archiver for a target, and return what CMake calls each."""
    folder.mkdir(parents=True, exist_ok=True)
    compilers = {"CMAKE_C_COMPILER": f"cc -target {target}", "CMAKE_CXX_COMPILER": f"c++ -target {target}"}
    commands = compilers | {"CMAKE_AR": "ar", "CMAKE_RANLIB": "ranlib"}
    for name, command in commands.items():
        script = folder / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang {command} "$@"\n', "utf-8")
        script.chmod(0o755)
    # CMake wants this program for macOS, though it runs only where something is installed
    return {name: str(folder / name) for name in commands} | {"CMAKE_INSTALL_NAME_TOOL": "install_name_tool"}


def run(*command: str | Path) -> None:
    quiet = os.environ | {"WINEDEBUG": "-all", "WINEPREFIX": str(ROOT / "build" / "exactness" / "wine")}
    result = subprocess.run(command, capture_output=True, text=True, check=False, env=quiet)
    if result.returncode:
        sys.exit(f"{' '.join(map(str, command[:4]))} ...\n{result.stdout[-4000:]}{result.stderr[-4000:]}")


def faults(out: Path) -> Iterator[str]:
    """Yield the differences between a build's results and the manifest of the vectors."""
    manifest = read_manifest()
    for name, vector in manifest["accept"].items():
        if not (out / f"{name}.points").exists():
            yield f"{name} is refused"
            continue
        for part, digest in vector["integers"].items():
            path = out / f"{name}.{part}"
            if path.exists() and hashlib.sha256(path.read_bytes()).hexdigest() != digest:
                yield f"{name}: other {part}"
        margin, points = read_points(out / f"{name}.points")
        runs = points_of_runs(points, vector)
        first, last = vector["positions"][0][0], vector["positions"][-1][0]
        ends = {last: runs[-1][-1], first: runs[0][0]}
        pinned = [(ends[time][vertex], place) for time, vertex, *place in vector["positions"] if time in ends]
        found, wanted = np.array(pinned, np.float64).swapaxes(0, 1)
        if np.abs(found - wanted).max() > allowed(margin, wanted):
            yield f"{name}: positions are {np.abs(found - wanted).max():g} off, margin {margin:g}"
    for name, vector in manifest["reject"].items():
        path = out / f"{name}.error"
        if vector["reason"].endswith(REMARKS) or vector.get("section") == "SCEN":
            continue
        if not path.exists() or path.read_text("utf-8").split()[0] != vector["error"]:
            yield f"{name} is not refused as {vector['error']}"


def differences(one: Path, other: Path) -> Iterator[str]:
    """Yield the forbidden differences between the results of two builds."""
    names = {path.name for path in one.iterdir()}
    if names != {path.name for path in other.iterdir()}:
        yield "the refused files differ"
        return
    for name in sorted(names):
        if not name.endswith(".points"):
            if (one / name).read_bytes() != (other / name).read_bytes():
                yield f"{name} differs"
            continue
        margins, points = zip(*(read_points(folder / name) for folder in (one, other)), strict=True)
        off = np.abs(points[0].astype(np.float64) - points[1]).max(initial=0.0)
        if margins[0] != margins[1] or off > allowed(margins[0], points[0]):
            yield f"{name}: positions are {off:g} apart, margin {margins[0]:g}"


def allowed(margin: float, points: np.ndarray) -> float:
    """Return the largest difference that positions from two decoders may have: each is within the margin of
    exact positions, and rounds to float32 twice.
    """
    between_frames = 1.25  # upper bound of the sum of the spline's absolute weights
    return 2 * (between_frames * margin + float(np.spacing(np.float32(np.abs(points).max(initial=0.0)))))


def read_points(path: Path) -> tuple[float, np.ndarray]:
    data = path.read_bytes()
    return float(np.frombuffer(data, np.float64, 1)[0]), np.frombuffer(data, np.float32, offset=8)


def points_of_runs(points: np.ndarray, vector: Any) -> list[np.ndarray]:
    """Return the positions of each run at the frames, without those between frames: (frames, vertices, 3) float32."""
    shapes = list(zip(np.ravel(vector["frames"]).tolist(), np.ravel(vector["vertices"]).tolist(), strict=True))
    starts = np.cumsum([0, *((2 * frames - 1) * 3 * vertices for frames, vertices in shapes)])
    return [
        points[start : start + frames * 3 * vertices].reshape(frames, vertices, 3)
        for start, (frames, vertices) in zip(starts[:-1], shapes, strict=True)
    ]


def main(names: list[str]) -> None:
    first: tuple[str, Path] | None = None
    failed = False
    for build in BUILDS:
        if names and build.name not in names:
            continue
        if build.missing:
            print(f"{build.name}: skipped, there is no {', '.join(build.missing)}")
            continue
        out = decoded(build)
        if not build.runs:
            print(f"{build.name}: compiled and linked; nothing here runs it")
            continue
        found = list(faults(out)) + (list(differences(first[1], out)) if first else [])
        print(f"{build.name}: {'; '.join(found) if found else 'as it should be'}")
        first = first or (build.name, out)
        failed = failed or bool(found)
    sys.exit(failed)


if __name__ == "__main__":
    main(sys.argv[1:])
