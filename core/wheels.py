"""Build wheels for Linux that older systems load: ``make wheels``.

    python -m core.wheels FOLDER [ARCHITECTURE ...]

GCC compiles the core for each architecture, and Zig links it: with the symbols of glibc 2.28, whatever the version
here. `bindings/python/linux` stands in for what GCC's headers need of a newer C++ library than GCC 8's. A wheel is
written only if auditwheel confirms its tag, and if Python or the system's libraries have all that its module needs.
"""

from __future__ import annotations

import argparse
import importlib.util
import io
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

GLIBC = "2.28"

COMPILERS = {"x86_64": ("x86_64-linux-gnu-g++", "g++"), "aarch64": ("aarch64-linux-gnu-g++", "g++")}
"""The C++ compilers of each architecture: a cross compiler, or this machine's own."""

NEWER = ROOT / "core" / "bindings" / "python" / "linux" / "newer_symbols.cpp"
"""Stands in for what GCC's headers need of newer libraries."""

MODULE = "_core.abi3.so"

COMPILER = """#!/bin/sh
# Links modules by Zig; does all else by GCC.
case " $* " in
*" -shared "*) exec "{python}" -m ziglang c++ -target {architecture}-linux-gnu.{glibc} -nostdlib++ "$@" {libraries} ;;
esac
exec {compiler} "$@"
"""


def find_compiler(architecture: str) -> str | None:
    """Return the C++ compiler for an architecture, or None if there is none here."""
    for name in COMPILERS[architecture]:
        if shutil.which(name) and output(name, "-dumpmachine").startswith(f"{architecture}-linux"):
            return name
    return None


def write_compiler(folder: Path, architecture: str, compiler: str) -> Path:
    """Write a script that compiles as `compiler` does and links by Zig, and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    newer = folder / "newer_symbols.o"
    run(compiler, "-c", "-O2", "-fPIC", "-std=c++20", "-o", str(newer), str(NEWER))
    # libgcc.a says what the processor has: Zig's own library does not look.
    names = ("libstdc++.so.6", "libgcc.a", "libgcc_s.so.1")
    libraries = [str(newer), *(output(compiler, f"-print-file-name={name}") for name in names)]
    script = folder / "c++"
    script.write_text(
        COMPILER.format(
            python=sys.executable,
            architecture=architecture,
            glibc=GLIBC,
            libraries=" ".join(libraries),
            compiler=compiler,
        ),
        "utf-8",
    )
    script.chmod(0o755)
    return script


def build_wheel(folder: Path, architecture: str, compiler: str) -> Path:
    """Build the wheel for an architecture, move it to `folder` if its tag is true, and return its path."""
    build = ROOT / "build" / "wheels" / architecture
    tag = f"manylinux_{GLIBC.replace('.', '_')}_{architecture}"
    settings = {
        "build-dir": str(build / "core"),
        "cmake.define.CMAKE_SYSTEM_NAME": "Linux",
        "cmake.define.CMAKE_SYSTEM_PROCESSOR": architecture,
    }
    (build / "core" / MODULE).unlink(missing_ok=True)  # links again: CMake does not know what the script links
    environment = {"CXX": str(write_compiler(build, architecture, compiler)), "_PYTHON_HOST_PLATFORM": tag}
    with tempfile.TemporaryDirectory() as scratch:
        flags = [f"--config-setting={name}={value}" for name, value in settings.items()]
        run(
            *(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", scratch, *flags, str(ROOT)),
            environment=environment,
        )
        (wheel,) = Path(scratch).glob("*.whl")
        shown = output(sys.executable, "-m", "auditwheel", "show", str(wheel))
        if f'"{tag}"' not in shown:
            sys.exit(f"{wheel.name} does not work wherever its tag says:\n{shown}")
        if missing := unresolved(wheel):
            sys.exit(f"{wheel.name} needs what no library has: {', '.join(missing)}; see {NEWER.name}")
        folder.mkdir(parents=True, exist_ok=True)
        return Path(shutil.move(wheel, folder / wheel.name))


def unresolved(wheel: Path) -> list[str]:
    """Return the symbols that a wheel's module needs and that neither Python nor a version of a library has."""
    from elftools.elf.elffile import ELFFile

    with zipfile.ZipFile(wheel) as archive, archive.open(f"pdecodec/{MODULE}") as file:
        module = ELFFile(io.BytesIO(file.read()))
        versions = module.get_section_by_name(".gnu.version")
        return [
            symbol.name
            for index, symbol in enumerate(module.get_section_by_name(".dynsym").iter_symbols())
            if symbol["st_shndx"] == "SHN_UNDEF"
            and symbol["st_info"]["bind"] == "STB_GLOBAL"
            and isinstance(versions.get_symbol(index)["ndx"], str)
            and not symbol.name.startswith(("Py", "_Py"))
        ]


def output(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def run(*command: str, cwd: Path = ROOT, environment: dict[str, str] | None = None) -> None:
    result = subprocess.run(
        command, cwd=cwd, env=os.environ | (environment or {}), capture_output=True, text=True, check=False
    )
    if result.returncode:
        sys.exit(f"{' '.join(command[:6])} ...\n{result.stdout[-4000:]}{result.stderr[-4000:]}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("architectures", nargs="*", default=list(COMPILERS))
    arguments = parser.parse_args()
    if importlib.util.find_spec("ziglang") is None or importlib.util.find_spec("auditwheel") is None:
        sys.exit("the packages ziglang and auditwheel are missing")
    compilers = {architecture: find_compiler(architecture) for architecture in arguments.architectures}
    for architecture, compiler in compilers.items():
        if compiler is None:
            print(f"{architecture}: skipped, there is no {' or '.join(COMPILERS[architecture])} for it")
        else:
            print(build_wheel(arguments.folder, architecture, compiler))
    if not any(compilers.values()):
        sys.exit("no wheel was built")


if __name__ == "__main__":
    main()
