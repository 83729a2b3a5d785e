"""Build the decoder as WebAssembly, with ziglang and Binaryen (``make wasm``).

    python core/bindings/wasm/build.py OUT.wasm

The package ziglang has clang, a linker, and a C and a C++ library for wasm32-wasi. Its C++ library is built without
exceptions, but the core reports errors by exceptions inside. So the parts that exceptions need are compiled here
from the package's sources, with WebAssembly's first form of exceptions, which every browser has had since 2022.

Binaryen's wasm-opt, run by Node, then makes the linked module smaller: 185 kB compressed instead of 198.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from pathlib import Path

CORE = Path(__file__).resolve().parents[2]

NOT_DECODED_WITH = {"bindings", "encode", "simulate", "tests", "text"}
"""Folders of the core whose code a decoder does not need."""

SECTION = b"pdeanim.sources"
"""Name of the custom section that records the sources of a module."""

TARGET = ["-target", "wasm32-wasi", "-mcpu=lime1+exception_handling+reference_types+simd128"]
"""Lime1 is the set of features that all engines have had since 2024; the other features are older still."""

FLAGS = [*TARGET, "-g0", "-fwasm-exceptions", "-mllvm", "-wasm-use-legacy-eh=true", "-ffunction-sections"]

OWN_FLAGS = ["-std=c++20", "-ffp-contract=off", "-fno-fast-math", "-fwrapv", "-DPDEANIM_STATIC"]

LIBRARY_FLAGS = [
    "-std=c++23",
    "-w",
    "-D_LIBCPP_BUILDING_LIBRARY",
    "-D_LIBCXXABI_BUILDING_LIBRARY",
    "-D_LIBCXXABI_HAS_NO_THREADS",
    "-D_LIBUNWIND_HIDE_SYMBOLS",
    "-DLIBCXX_BUILDING_LIBCXXABI",
    "-DLIBCXXABI_NON_DEMANGLING_TERMINATE",
]

LIBRARY = {
    "libcxx/src": (
        *("algorithm.cpp", "call_once.cpp", "exception.cpp", "functional.cpp", "hash.cpp", "memory.cpp"),
        *("new_helpers.cpp", "optional.cpp", "stdexcept.cpp", "string.cpp", "variant.cpp", "vector.cpp"),
    ),
    "libcxxabi/src": (
        *("cxa_aux_runtime.cpp", "cxa_default_handlers.cpp", "cxa_exception.cpp", "cxa_exception_storage.cpp"),
        *("cxa_guard.cpp", "cxa_handlers.cpp", "cxa_personality.cpp", "cxa_virtual.cpp", "fallback_malloc.cpp"),
        *("private_typeinfo.cpp", "stdlib_exception.cpp", "stdlib_new_delete.cpp", "stdlib_stdexcept.cpp"),
        "stdlib_typeinfo.cpp",
    ),
    "libunwind/src": ("Unwind-wasm.c",),
}
"""Sources of the package's folder ``lib`` that are compiled."""

QUICK = {"decode/evaluate/evaluate.cpp", "linalg/products.cpp"}
"""Sources of the core that are compiled for speed; all others are compiled for size."""

STACK_BYTES = 1 << 20

BINARYEN = CORE.parent / "build" / "binaryen" / "node_modules" / "binaryen"
"""Where ``make wasm`` installs Binaryen."""

OPTIMISER_FLAGS = [
    "-Oz",
    "--converge",
    *("--enable-bulk-memory", "--enable-exception-handling", "--enable-extended-const", "--enable-multivalue"),
    *("--enable-mutable-globals", "--enable-nontrapping-float-to-int", "--enable-reference-types"),
    *("--enable-sign-ext", "--enable-simd"),
]
"""Allow only the features of ``TARGET``, and repeat the passes until the module no longer shrinks."""


def sources() -> list[Path]:
    """List the source files of the module, headers included."""

    def is_decoded_with(path: Path) -> bool:
        return path.relative_to(CORE).parts[0] not in NOT_DECODED_WITH

    found = [path for path in CORE.rglob("*") if path.suffix in {".cpp", ".hpp", ".h"} and is_decoded_with(path)]
    bindings = [path for name in ("c", "wasm") for path in (CORE / "bindings" / name).rglob("*")]
    return sorted(found + [path for path in bindings if path.is_file() and "__pycache__" not in path.parts])


COMMENTS = re.compile(r"""//[^\n]*|/\*.*?\*/|("(?:\\.|[^"\\])*"|'(?:\\[^\n']+|[^'\\\n])')""", re.DOTALL)
"""Matches comments of C++, and (as group 1) string and character literals, in which no comment begins."""


def digest() -> str:
    """Return the SHA-256 of the names and contents of the sources. Comments and layout are left out: they do
    not change the module.
    """
    found = hashlib.sha256()
    for path in sources():
        code = COMMENTS.sub(lambda match: match[1] or " ", path.read_text("utf-8"))
        content = " ".join(code.split()).encode()
        found.update(f"{path.relative_to(CORE).as_posix()} {len(content)}\n".encode() + content)
    return found.hexdigest()


def exported() -> list[str]:
    """Return the names of the functions of the C interface."""
    header = (CORE / "bindings" / "c" / "include" / "pdeanim.h").read_text("utf-8")
    return re.findall(r"PDEANIM_API [^;(]*?\b(pdeanim_\w+)\(", header)


def unsigned(number: int) -> bytes:
    """Encode a number as WebAssembly does (LEB128)."""
    found = bytearray()
    while number > 0x7F:
        found.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*found, number])


def custom_section(content: bytes) -> bytes:
    body = unsigned(len(SECTION)) + SECTION + content
    return b"\0" + unsigned(len(body)) + body


def built_from(module: bytes) -> dict[str, str]:
    """Return the record in a module's custom section: ``sources``, the digest of its sources, and the versions
    ``ziglang`` and ``binaryen``.
    """
    at = module.rindex(SECTION) + len(SECTION)
    found: dict[str, str] = json.loads(module[at:])
    return found


def binaryen_version() -> str | None:
    """Return the installed version of Binaryen, or ``None``."""
    package = BINARYEN / "package.json"
    if not package.exists():
        return None
    found: str = json.loads(package.read_text("utf-8"))["version"]
    return found


def run(command: Sequence[str | Path]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stderr}")


def commands(library: Path, folder: Path) -> Iterator[list[str | Path]]:
    """Yield the commands that compile each source to an object in a folder."""
    zig = [sys.executable, "-m", "ziglang"]
    includes = [library / name for name in ("libcxx/src", "libcxxabi/src", "libcxxabi/include", "libunwind/include")]
    for name in (f"{part}/{name}" for part, names in LIBRARY.items() for name in names):
        compiler = "cc" if name.endswith(".c") else "c++"
        flags = [flag for flag in LIBRARY_FLAGS if compiler == "c++" or not flag.startswith("-std")]
        out = folder / f"library-{Path(name).stem}.o"
        given = [*flags, *(f"-I{path}" for path in includes)]
        yield [*zig, compiler, *FLAGS, "-Oz", *given, "-c", library / name, "-o", out]
    includes = [CORE, CORE / "bindings" / "c" / "include"]
    threads = CORE / "bindings" / "wasm" / "single_thread.hpp"
    for path in sources():
        if path.suffix != ".cpp":
            continue
        out = folder / f"{path.parent.name}-{path.stem}.o"
        level = "-Os" if path.relative_to(CORE).as_posix() in QUICK else "-Oz"
        given = [*OWN_FLAGS, "-include", threads, *(f"-I{path}" for path in includes)]
        yield [*zig, "c++", *FLAGS, level, *given, "-c", path, "-o", out]


def build(out: Path, jobs: int = 2) -> None:
    """Build the module and write it."""
    spec = importlib.util.find_spec("ziglang")
    if spec is None or spec.origin is None:
        sys.exit("the package ziglang is missing; run: pip install ziglang")
    node = shutil.which("node")
    binaryen = binaryen_version()
    if node is None or binaryen is None:
        sys.exit("Node or Binaryen is missing; install Node with npm, then run make wasm")
    library = Path(spec.origin).parent / "lib"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(run, commands(library, folder)))
        exports = [f"-Wl,--export={name}" for name in (*exported(), "malloc", "free")]
        linked = folder / "linked.wasm"
        # Sort them: their order must not depend on the file system, so that the same sources give the same bytes.
        objects = sorted(folder.glob("*.o"))
        link = ["-mexec-model=reactor", "-O2", "-s", "-Wl,--gc-sections", f"-Wl,-z,stack-size={STACK_BYTES}", *exports]
        run([sys.executable, "-m", "ziglang", "cc", *TARGET, *link, *objects, "-o", linked])
        smaller = folder / "smaller.wasm"
        run([node, BINARYEN / "bin" / "wasm-opt", *OPTIMISER_FLAGS, linked, "-o", smaller])
        made = {"sources": digest(), "ziglang": version("ziglang"), "binaryen": binaryen}
        out.write_bytes(smaller.read_bytes() + custom_section(json.dumps(made).encode()))


if __name__ == "__main__":
    build(Path(sys.argv[1]))
