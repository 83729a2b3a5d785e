"""The C interface: installed as a library, and used by the program in `examples/c`."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from core.amalgamation import write as write_amalgamation
from pdecodec import encode, open_animation
from pdecodec.codec.sections.fields import DOMAINS
from pdecodec.mesh.fields import DTYPES
from pdecodec.mesh.sequence import MeshSequence
from spec.accepted import several_objects, with_attributes
from spec.vector_files import accepted_files, accepted_vectors

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "c" / "play.c"
HEADER = (ROOT / "core" / "bindings" / "c" / "include" / "pdeanim.h").read_text()
MISUSE = ROOT / "core" / "tests" / "misuse.c"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder where `cmake --install` has put the library."""
    builds = [path.parent for path in ROOT.glob("build/cp*/build.ninja")]
    if not builds or shutil.which("cmake") is None:
        pytest.skip("the core is not built here, or cmake is not in the path")
    prefix: Path = tmp_path_factory.mktemp("installed")
    newest = max(builds, key=lambda build: (build / "build.ninja").stat().st_mtime)
    # The object files exist since the package was installed.
    run("cmake", "--build", newest, "--target", "pdeanim")
    run("cmake", "--install", newest, "--component", "library", "--prefix", prefix)
    return prefix


def run(*command: str | Path, **environment: str | Path) -> str:
    """Run a command with additional `environment`; return its standard output."""
    added = {name: os.fspath(value) for name, value in environment.items()}
    done = subprocess.run(command, env=os.environ | added, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def library_of(installed: Path) -> Path:
    (found,) = installed.glob("lib*/libpdeanim.so")
    return found


@pytest.fixture(scope="module")
def player(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the example program, compiled as a user of the library would."""
    program: Path = tmp_path_factory.mktemp("player") / "play"
    compile_c(EXAMPLE, program, installed)
    return program


def compile_c(source: Path, program: Path, installed: Path) -> None:
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler in the path")
    folder = library_of(installed).parent
    flags = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-O2", f"-I{installed / 'include'}"]
    run("cc", *flags, source, f"-L{folder}", "-lpdeanim", f"-Wl,-rpath,{folder}", "-o", program)


def link_by_cmake(installed: Path, folder: Path) -> Path:
    """Build the example as a project in C alone that finds the installed library by CMake."""
    (folder / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.20)\nproject(player LANGUAGES C)\n"
        "find_package(pdeanim 1.0 REQUIRED)\n"
        f'add_executable(play "{EXAMPLE}")\n'
        "target_link_libraries(play PRIVATE pdeanim::pdeanim)\n"
    )
    run("cmake", "-S", folder, "-B", folder / "build", f"-DCMAKE_PREFIX_PATH={installed}")
    run("cmake", "--build", folder / "build")
    return folder / "build" / "play"


def link_by_pkg_config(installed: Path, folder: Path, *options: str) -> Path:
    """Compile the example with the flags that pkg-config prints."""
    if shutil.which("pkg-config") is None:
        pytest.skip("pkg-config is not in the path")
    (found,) = installed.glob("lib*/pkgconfig")
    assert run("pkg-config", "--modversion", "pdeanim", PKG_CONFIG_PATH=found).strip() == "1.0.0"
    flags = run("pkg-config", *options, "--cflags", "--libs", "pdeanim", PKG_CONFIG_PATH=found).split()
    run("cc", EXAMPLE, *flags, f"-Wl,-rpath,{found.parent}", "-o", folder / "play")
    return folder / "play"


@pytest.mark.parametrize("options", [None, (), ("--static",)], ids=["cmake", "pkg-config", "pkg-config --static"])
def test_a_program_in_c_links_and_plays(installed: Path, tmp_path: Path, options: tuple[str, ...] | None) -> None:
    check_linking(installed, tmp_path, options)


@pytest.mark.long
@pytest.mark.parametrize("chosen", [(), ("-DBUILD_SHARED_LIBS=OFF",)], ids=["default", "static"])
def test_a_program_in_c_links_each_build_of_the_library(tmp_path: Path, chosen: tuple[str, ...]) -> None:
    if shutil.which("cmake") is None:
        pytest.skip("cmake is not in the path")
    build, installed = tmp_path / "build", tmp_path / "installed"
    run("cmake", "-S", ROOT / "core", "-B", build, "-DCMAKE_BUILD_TYPE=Debug", *chosen)
    run("cmake", "--build", build, "--parallel", "2")
    run("cmake", "--install", build, "--prefix", installed)
    kinds = {path.suffix for path in installed.glob("lib*/libpdeanim*")} - {".1", ".0"}
    assert kinds == ({".a"} if chosen else {".so"})
    for number, options in enumerate((None, (), ("--static",))):
        folder = tmp_path / str(number)
        folder.mkdir()
        check_linking(installed, folder, options)


def check_linking(installed: Path, folder: Path, options: tuple[str, ...] | None) -> None:
    """Link the example by CMake, or by pkg-config with options, and convert a file with it."""
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler in the path")
    player = link_by_cmake(installed, folder) if options is None else link_by_pkg_config(installed, folder, *options)
    out = folder / "out"
    out.mkdir()
    run(player, accepted_files()["groups"], out)
    with open_animation(accepted_files()["groups"]) as animation:
        assert len(list(out.iterdir())) == animation.frame_count


def points_of(path: Path) -> np.ndarray:
    rows = [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")]
    return np.array(rows, np.float64).astype(np.float32)


def encoded(sequence: MeshSequence, path: Path) -> Path:
    encode(sequence, path, tolerance=1e-3)
    return path


def test_the_example_has_fewer_than_a_hundred_lines() -> None:
    assert len(EXAMPLE.read_text().splitlines()) < 100


def test_the_example_plays_a_file_to_obj_at_any_rate(player: Path, tmp_path: Path) -> None:
    source = encoded(several_objects(), tmp_path / "clip.pdeanim")
    out = tmp_path / "out"
    out.mkdir()
    subprocess.run([player, source, out, "37"], check=True)
    with open_animation(source) as animation:
        files = sorted(out.iterdir())
        assert len(files) > 1
        for index, file in enumerate(files):
            expected = animation.positions(float(animation.times[0]) + index / 37)
            assert np.array_equal(points_of(file), expected)
        faces = [line for line in files[0].read_text().splitlines() if line.startswith("f ")]
        assert len(faces) == sum(item.connectivity.face_counts.size for item in animation.objects)


def test_the_example_reports_a_malformed_file_in_one_line(player: Path, tmp_path: Path) -> None:
    source = encoded(several_objects(), tmp_path / "clip.pdeanim")
    (tmp_path / "short.pdeanim").write_bytes(source.read_bytes()[:-1])
    run = subprocess.run([player, tmp_path / "short.pdeanim", tmp_path], capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert "is truncated" in run.stderr


@pytest.mark.long
@pytest.mark.parametrize("compiler", ["g++", "clang++"])
def test_the_decoder_in_one_file_gives_the_same_positions(player: Path, tmp_path: Path, compiler: str) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not in the path")
    write_amalgamation(tmp_path)
    (tmp_path / "include").mkdir()
    (tmp_path / "pdeanim.h").rename(tmp_path / "include/pdeanim.h")
    flags = ["-std=c++20", "-O2", "-Wall", "-Wextra", "-Werror", f"-I{tmp_path / 'include'}"]
    run(compiler, *flags, "-c", tmp_path / "pdeanim.cpp", "-o", tmp_path / "pdeanim.o")
    run("cc", "-std=c11", f"-I{tmp_path / 'include'}", "-c", EXAMPLE, "-o", tmp_path / "play.o")
    run(compiler, tmp_path / "play.o", tmp_path / "pdeanim.o", "-pthread", "-o", tmp_path / "play")
    for name in ("groups", "polygons_attributes", "many_patches"):
        folders = [tmp_path / name / kind for kind in ("library", "one_file")]
        for folder, program in zip(folders, (player, tmp_path / "play"), strict=True):
            folder.mkdir(parents=True)
            run(program, accepted_files()[name], folder, "19")
        files = [path.name for path in folders[0].iterdir()]
        assert len(files) > 1
        assert all((folders[0] / name).read_bytes() == (folders[1] / name).read_bytes() for name in files)


def test_the_decoder_in_one_file_includes_no_other_of_ours(tmp_path: Path) -> None:
    write_amalgamation(tmp_path)
    text = (tmp_path / "pdeanim.cpp").read_text()
    assert re.findall(r'#\s*include\s*"(.*)"', text) == ["pdeanim.h"]
    assert (tmp_path / "pdeanim.h").read_text() == HEADER
    functions = re.findall(r"^PDEANIM_API .*?(pdeanim_\w+)\(", HEADER, re.MULTILINE)
    assert len(functions) > 20
    assert [name for name in functions if not re.search(rf"\b{name}\([^;{{]*{{", text)] == []
    assert "encode_residuals" not in text, "what only an encoder needs is left out"


def test_only_the_interface_is_seen_from_outside(installed: Path) -> None:
    if shutil.which("nm") is None:
        pytest.skip("nm is not in the path")
    command = ["nm", "-D", "--defined-only", os.fspath(library_of(installed))]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    names = {line.split()[-1].split("@")[0] for line in listed}
    assert {name for name in names if not name.startswith("pdeanim_")} <= {"_init", "_fini"}
    assert all(f"{name}(" in HEADER for name in names if name.startswith("pdeanim_"))


def test_misuse_of_the_interface_is_refused_without_a_crash(installed: Path, tmp_path: Path) -> None:
    compile_c(MISUSE, tmp_path / "misuse", installed)
    files = (accepted_files()[name] for name in ("polygons_attributes", "runs", "fields"))
    printed = run(tmp_path / "misuse", *files)
    assert ", 0 not as they must be" in printed


OPTIONAL = {"options", "error", "user"}
"""Parameters that may be NULL."""


def test_the_table_of_misuse_has_every_pointer_of_every_function_of_the_header() -> None:
    declared = dict(re.findall(r"PDEANIM_API [^;(]*?\b(pdeanim_\w+)\(([^)]*)\)", HEADER))
    rows: dict[str, list[list[str]]] = {}
    for name, arguments in re.findall(r"\b(pdeanim_\w+)(?:, |\()([^;]*)\);", MISUSE.read_text()):
        rows.setdefault(name, []).append([argument.strip() for argument in arguments.split(",")])
    assert len(declared) > 25
    assert declared.keys() <= rows.keys()
    for name, parameters in declared.items():
        for place, parameter in enumerate(parameters.split(",")):
            called = re.split(r"[ *]+", parameter.strip())[-1]
            if ("*" not in parameter and called != "read") or called in OPTIONAL:
                continue
            given = {row[place] for row in rows[name] if len(row) > place}
            is_handle = place == 0 and called == "animation"
            assert given >= ({"NULL", "closed"} if is_handle else {"NULL"}), (name, called)


class Error(ctypes.Structure):
    _fields_ = (
        ("status", ctypes.c_int),
        ("offset", ctypes.c_int64),
        ("frame", ctypes.c_int64),
        ("text", ctypes.c_char * 256),
    )


class Options(ctypes.Structure):
    _fields_ = (
        ("size", ctypes.c_size_t),
        ("max_memory", ctypes.c_uint64),
        ("threads", ctypes.c_uint32),
        ("max_output", ctypes.c_uint64),
    )


@pytest.mark.parametrize("name", ["many_pieces", "runs"])
def test_a_file_that_declares_more_positions_or_needs_more_memory_than_is_wanted_is_refused(
    installed: Path, name: str
) -> None:
    library = ctypes.CDLL(os.fspath(library_of(installed)))
    path = accepted_files()[name]
    data = path.read_bytes()
    with open_animation(path) as animation:
        declared = 12 * animation.position_count

    def opened(max_output: int, size: int = ctypes.sizeof(Options), max_memory: int = 0) -> tuple[int, bytes]:
        handle, error = ctypes.c_void_p(), Error()
        options = Options(size, max_memory, 1, max_output)
        status = library.pdeanim_open_memory(data, ctypes.c_size_t(len(data)), ctypes.byref(options),
                                             ctypes.byref(handle), ctypes.byref(error))  # fmt: skip
        assert (status == 0) == (handle.value is not None)
        library.pdeanim_close(handle)
        return status, error.text

    assert opened(declared) == opened(0) == (0, b"")
    status, text = opened(declared - 1)
    assert (status, b"the output limit is" in text) == (2, True)
    status, text = opened(0, max_memory=1000)
    assert (status, b"more than the memory limit allows" in text) == (2, True)
    # A program that was compiled before the field existed does not set it.
    assert opened(1, size=Options.max_output.offset) == (0, b"")


def test_a_read_function_is_called_for_bytes_alone(installed: Path) -> None:
    library = ctypes.CDLL(os.fspath(library_of(installed)))
    data = accepted_vectors()["static"]
    sizes: list[int] = []

    @ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_void_p, ctypes.c_size_t)
    def read(_: int | None, offset: int, into: int | None, size: int) -> int:
        sizes.append(size if into else 0)
        piece = data[offset : offset + size]
        ctypes.memmove(into, piece, len(piece))
        return len(piece)

    handle, error = ctypes.c_void_p(), Error()
    assert library.pdeanim_open_read(read, None, ctypes.c_uint64(len(data)), None, ctypes.byref(handle),
                                     ctypes.byref(error)) == 0  # fmt: skip
    assert library.pdeanim_verify(handle, ctypes.byref(error)) == 0
    library.pdeanim_close(handle)
    assert sizes
    assert min(sizes) > 0


def test_arguments_and_damage_end_in_codes_and_never_in_a_crash(installed: Path, tmp_path: Path) -> None:
    library = ctypes.CDLL(os.fspath(library_of(installed)))
    data = encoded(with_attributes(), tmp_path / "clip.pdeanim").read_bytes()
    handle, error = ctypes.c_void_p(), Error()

    def open_with(content: bytes) -> int:
        place = ctypes.c_char_p(content)
        return int(library.pdeanim_open_memory(place, ctypes.c_size_t(len(content)), None, ctypes.byref(handle),
                                               ctypes.byref(error)))  # fmt: skip

    for size in range(0, len(data), 7):
        assert open_with(data[:size]) == 1
        assert handle.value is None
        assert error.text
    assert open_with(data) == 0
    library.pdeanim_vertex_count.restype = ctypes.c_int64
    vertices = library.pdeanim_vertex_count(handle)
    out = np.empty((2, vertices, 3), np.float32)
    times = np.array([0.0, 0.05])

    def evaluate(quantity: int, which: int) -> int:
        return int(library.pdeanim_evaluate(handle, quantity, ctypes.c_void_p(times.ctypes.data), ctypes.c_size_t(2),
                                            ctypes.c_int64(which), ctypes.c_void_p(out.ctypes.data),
                                            ctypes.byref(error)))  # fmt: skip

    for quantity, name in enumerate(("positions", "velocities", "accelerations")):
        assert evaluate(quantity, -1) == 0
        with open_animation(data) as animation:
            assert np.array_equal(out, getattr(animation, name)(times))
    library.pdeanim_cancel(handle)
    assert evaluate(0, -1) == 0, "cancelling is for calls that are under way"
    assert evaluate(3, -1) == 3
    assert b"unknown quantity" in error.text
    assert evaluate(0, 99) == 3
    assert b"there is no object 99" in error.text
    for count in (-1, -(2**62)):
        found = library.pdeanim_evaluate(handle, 0, ctypes.c_void_p(times.ctypes.data), ctypes.c_size_t(count),
                                         ctypes.c_int64(-1), ctypes.c_void_p(out.ctypes.data),
                                         ctypes.byref(error))  # fmt: skip
        assert (found, error.text) == (3, b"there cannot be so many times")
    times[0] = np.nan
    assert evaluate(0, -1) == 3
    library.pdeanim_close(handle)


class CField(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_char_p) for name in ("name", "unit")),
        *((name, ctypes.c_int) for name in ("domain", "type")),
        *((name, ctypes.c_int64) for name in ("row_count", "column_count")),
        ("value_bytes", ctypes.c_size_t),
        *((name, ctypes.c_double) for name in ("smallest", "largest", "bound")),
        ("object_count", ctypes.c_int64),
        ("objects", ctypes.POINTER(ctypes.c_int64)),
    )


@pytest.mark.parametrize("name", [name for name in accepted_files() if name.startswith("fields")])
def test_fields_are_those_of_python_at_all_frames_and_between(installed: Path, name: str) -> None:
    library = ctypes.CDLL(os.fspath(library_of(installed)))
    data = accepted_vectors()[name]
    whole, handle, count, error = ctypes.c_void_p(), ctypes.c_void_p(), ctypes.c_int64(), Error()

    def call(function: str, *arguments: object) -> None:
        status = getattr(library, f"pdeanim_{function}")(*arguments, ctypes.byref(error))
        assert (status, error.text) == (0, b"")

    call("open_memory", data, ctypes.c_size_t(len(data)), None, ctypes.byref(whole))
    with open_animation(data) as animation:
        for number, run in enumerate(animation.runs):
            call("open_run", whole, ctypes.c_int64(number), ctypes.byref(handle))
            call("field_count", handle, ctypes.byref(count))
            assert count.value == len(run.fields)
            times = np.sort(np.concatenate([run.times, np.linspace(run.times[0] - 0.1, run.times[-1] + 0.1, 11)]))
            for index, field in enumerate(run.fields):
                found, derivatives = CField(), range(1 if field.is_exact else 3)
                call("get_field", handle, ctypes.c_int64(index), ctypes.byref(found))
                assert (found.name, found.unit) == (field.name.encode(), field.unit.encode())
                assert (DOMAINS[found.domain], DTYPES[found.type]) == (field.domain, field.dtype)
                assert (tuple(found.objects[: found.object_count]) or None) == field.objects
                stored = run.stored_fields[index]
                limits = (stored.smallest, stored.largest, stored.bound)
                assert (found.smallest, found.largest, found.bound) == limits
                for derivative in derivatives:
                    expected = run.field(field.name, times, derivative=derivative)
                    out = np.empty_like(expected)
                    assert out.size == times.size * found.row_count * found.column_count
                    call("evaluate_field", handle, ctypes.c_int64(index), ctypes.c_void_p(times.ctypes.data),
                         ctypes.c_size_t(times.size), derivative, ctypes.c_void_p(out.ctypes.data),
                         ctypes.c_size_t(out.nbytes))  # fmt: skip
                    np.testing.assert_array_equal(out.view(np.uint8), expected.view(np.uint8), field.name)
            library.pdeanim_close(handle)
    library.pdeanim_close(whole)
