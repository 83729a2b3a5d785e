"""Open and write a sequence of any registered format, at a path or an address."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pdecodec.errors import CorruptFileError, InputError, LimitError, SettingsError, naming_file
from pdecodec.formats.base.attribute_roles import VELOCITIES, is_velocity
from pdecodec.formats.base.frame_files import FOLDER_PADDING, other_frames_notice
from pdecodec.formats.base.registry import (
    Format,
    Output,
    Reader,
    Transforms,
    Writer,
    extensions_of,
    format_of_extension,
    format_to_read,
    format_to_write,
    load,
    titles_of,
    unknown_format,
)
from pdecodec.formats.base.surface import surface_of
from pdecodec.formats.base.times import times_kept
from pdecodec.formats.base.transforms import bake_transforms
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.arguments import as_number, as_path, as_positive, shown
from pdecodec.system.reading import allowed_folders, asset_folders_allowed
from pdecodec.system.storage import RemoteFile, is_address, remote_output
from pdecodec.system.whole_output import check_path, finish_interrupted

if TYPE_CHECKING:
    from pdecodec.codec.settings import EncodeSettings

_FORMAT_OPTIONS = ("mesh", "clip", "displacement", "solids")
"""Options of :func:`open_sequence` that are refused for formats that do not use them."""


CARRIED_FILE, WRITE_SCENE = (f"pdecodec.formats.base.carrying:{name}" for name in ("CarriedFile", "write_scene"))
"""The class that carries the scene of a file, and the function that writes it. They are loaded by name, because
their module imports this one.
"""


def open_sequence(
    path: str | os.PathLike[str],
    *,
    fps: float | None = None,
    mesh: str | os.PathLike[str] | None = None,
    clip: str | None = None,
    displacement: str | None = None,
    solids: Literal["surface", "keep"] | None = None,
    transforms: Transforms = "bake",
    skip_unsupported: bool = False,
    isolate: bool = False,
    asset_folders: Iterable[str | os.PathLike[str]] = (),
) -> MeshSequence:
    """Open a mesh sequence of any registered format.

    Parameters
    ----------
    path : path
        A file, a frame pattern (``name.####.obj``, ``name.%04d.obj``, ``name.@@@@.obj``, ``name.$F4.obj``,
        ``name.10-20####.obj`` for some frames of it, ``name.*.obj``), a folder of numbered frames, or the address of a
        file (``https://``, ``s3://``; extra ``remote``).
    fps : float, optional
        Frames per second of a source that does not store its times. Stored times are kept, and `fps` is then only the
        nominal rate, as a notice says. Scenes have a value at any time (Alembic, USD, glTF): they are sampled at this
        rate, from their first key to their last.
    mesh : path, optional
        File to take names, faces and attributes from for a point cache that has only positions (MDD, PC2): any file
        that can be opened here and has as many vertices.
    clip : str, optional
        Name of the animation to take from a file that has several (glTF). Default: the first.
    displacement : str, optional
        Name of the vectors on nodes that are added to the geometry of a simulation (VTK, XDMF, Exodus); ``none`` adds
        none. Default: those that the format itself defines as displacements; a notice lists the others.
    solids : {"surface", "keep"}, optional
        What becomes of solid elements of a simulation (VTK, XDMF, Exodus). keep: objects with solids have all elements
        of the file as cells, with their data, and all nodes. Default: their surface alone.
    transforms : {"bake", "keep"}
        For formats with transforms above objects: apply them to the positions, or keep them as the attribute
        ``transform`` (:mod:`pdecodec.formats.base.transforms`). Other formats have none.
    skip_unsupported : bool
        Leave out objects that cannot be read, with a notice for each, instead of refusing the file.
    isolate : bool
        Read in a separate process: a malicious file can crash the libraries that read Alembic, USD and VTK, and the
        process with them. Costs half a second, and copying every frame.
    asset_folders : iterable of path
        Folders in and below which the file may refer to others (buffers, layers, heavy data), in addition to its own
        folder. The environment variable ``PDECODEC_ASSET_FOLDERS`` lists more.

    Returns
    -------
    MeshSequence
        Reads frames when they are asked for; close it, or use it in a ``with`` statement.

    Raises
    ------
    InputError
        If the file does not exist, has no known format, is damaged, is no regular file, or refers to a file elsewhere.
    SettingsError
        If `mesh`, `clip`, `displacement` or `solids` is given for a format that does not use it.
    MissingExtraError
        If the format needs a package that is not installed.
    """
    fps = None if fps is None else as_positive(fps, "fps")
    given = {
        "mesh": mesh,
        "clip": clip,
        "displacement": displacement,
        "solids": solids,
        "transforms": transforms,
        "skip_unsupported": skip_unsupported,
    }
    with asset_folders_allowed(asset_folders):
        if is_address(path):
            return _open_remote(RemoteFile(str(path)), fps, {**given, "isolate": isolate})
        return _open_here(as_path(path), fps, given, isolate=isolate)


def _open_here(where: Path, fps: float | None, given: dict[str, Any], *, isolate: bool) -> MeshSequence:
    """Open the sequence at a local path; `given` holds options of :func:`open_sequence`."""
    finish_interrupted(where if where.is_dir() else where.parent)
    entry = format_to_read(where)
    for name in _FORMAT_OPTIONS:
        if given[name] is not None and name not in entry.options:
            raise misplaced(name, _users(name), where)
    if isolate:
        from pdecodec.formats.base.isolated import IsolatedSequence

        with naming_file(where):
            mesh = given["mesh"]
            files = {"mesh": None if mesh is None else os.path.abspath(mesh), "asset_folders": allowed_folders()}
            return IsolatedSequence(where, open_sequence, {**given, **files, "fps": fps})
    reader: Reader = load(entry, entry.reader, "read", where)
    with naming_file(where):
        sequence = reader(where, fps=fps, **{name: given[name] for name in entry.options})
    if entry.carrier is not None and len(sequence.runs) == 1:
        sequence.carried = load(entry, CARRIED_FILE, "read", where)(entry, where, sequence)
    if entry.frame_per_file and where.is_file():
        sequence.notices = (*sequence.notices, *other_frames_notice(where))
    return sequence


def _open_remote(file: RemoteFile, fps: float | None, options: dict[str, Any]) -> MeshSequence:
    """Open the sequence at an address: in place if the format allows it, else fetched into a temporary folder."""
    entry = format_of_extension(Path(file.name))
    if entry is None or not entry.reads:
        raise unknown_format(file.address)
    size = file.size()  # Fails if there is no such file.
    if entry.from_address and not options["isolate"]:
        for name in _FORMAT_OPTIONS:
            if options[name] is not None:
                raise misplaced(name, _users(name), file.address)
        reader: Reader = load(entry, entry.reader, "read", Path(file.name))
        with naming_file(file.address):
            return reader(file, fps=fps)
    folder = Path(tempfile.mkdtemp(prefix="pdecodec-"))
    try:
        if shutil.disk_usage(folder).free < size:
            raise InputError(
                f"takes {size} bytes, more than are free in {folder}; free some space",
                code="too-large",
                path=file.address,
            )
        file.fetch(folder / file.name)
        sequence = open_sequence(folder / file.name, fps=fps, **options)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(sequence, shutil.rmtree, folder, ignore_errors=True)
    return sequence


def write_sequence(
    sequence: MeshSequence,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    fps: float | None = None,
    velocities: MeshSequence | None = None,
    progress: Progress | None = None,
    quantize: bool = False,
    meshopt: bool = False,
    web: bool = False,
    straight: bool = False,
    looks_of: MeshSequence | None = None,
    rigid: float | None = None,
    motion: EncodeSettings | None = None,
    scene: Literal["keep", "drop"] = "keep",
    isolate: bool = False,
) -> tuple[str, ...]:
    """Write a mesh sequence in the format that the path's extension names, block by block.

    The output appears when it is complete: it is written to a temporary path next to it, then renamed.

    Parameters
    ----------
    sequence : MeshSequence
    path : path
        A file; for a format of one file per frame a pattern or a folder (``name/`` or no extension: OBJ); or the
        address of a file, which is written locally and uploaded when it is complete.
    overwrite : bool
        Replace an existing output.
    fps : float, optional
        Nominal frame rate to record and to number frames by. Default: the sequence's.
    velocities : MeshSequence, optional
        [scene units / s] at the same times, for formats that hold them (Alembic, USD).
    progress : callable, optional
        Called as ``progress(done, total, what)``.
    quantize : bool
        glTF: positions and weights of 16 bits, normals of 8 (KHR_mesh_quantization); a notice says how large the error
        is.
    meshopt : bool
        glTF: compressed without loss (EXT_meshopt_compression), for viewers that support it.
    web : bool
        glTF: as small as viewers on the web accept; sets `quantize` and `meshopt`, and `rigid` where it has a bound.
    straight : bool
        glTF: move a decoded animation in straight lines from frame to frame, as other sequences do, instead of along
        its splines: the keys of most scenes mean straight lines.
    looks_of : MeshSequence, optional
        glTF: an open glTF file whose materials, with their textures, are written for materials of the same name.
        Default: the sequence itself, if it is a glTF file.
    rigid : float, optional
        glTF, Alembic, USD: write objects that move rigidly within this distance [scene units] at their frames as moving
        nodes, in glTF objects of several such parts as skins; a notice gives the largest error. 0: only objects that
        move rigidly to the last bits of float32. Default: in glTF the bound of a decoded animation, else 0.
    motion : EncodeSettings, optional
        glTF: instead of morph targets, store a `.pdeanim` file that moves the meshes (PDECODEC_mesh_motion), encoded
        with these settings. Without a tolerance, that of an animation is stored without encoding it again. Rigid
        objects are moving nodes, unless `rigid` is 0 or an animation is stored. Vertices and faces stand in another
        order, and faces are triangles. Viewers without the extension show the first frame.
    scene : {"keep", "drop"}
        Of an animation that carries its scene (cameras, materials, custom data) in this format: write the scene with
        the motion, as :func:`pdecodec.formats.write_onto` does, or the meshes alone. `quantize`, `web` and `rigid`
        write the meshes alone.
    isolate : bool
        Write a scene that a file carries in a separate process: a malicious one can crash the libraries of Alembic, USD
        and HDF5, and the process with them. Costs half a second, and copying every frame.

    Returns
    -------
    tuple of str
        A line for each thing that the format could not hold.

    Raises
    ------
    InputError
        If the path exists or cannot be written to, or the format cannot hold the sequence.
    SettingsError
        If the format does not have an option.
    MissingExtraError
        If the format needs a package that is not installed.
    """
    if is_address(path):
        with remote_output(str(path), overwrite=overwrite) as local:
            return write_sequence(
                sequence,
                local,
                fps=fps,
                velocities=velocities,
                progress=progress,
                quantize=quantize,
                meshopt=meshopt,
                web=web,
                straight=straight,
                looks_of=looks_of,
                rigid=rigid,
                motion=motion,
                scene=scene,
                isolate=isolate,
            )
    where = as_path(path)
    check_path(where)
    fps = None if fps is None else as_positive(fps, "fps")
    if not isinstance(sequence, MeshSequence):
        raise InputError(f"{shown(sequence)} is not a mesh sequence; pass one, such as an ArraySequence", path=where)
    if rigid is not None and as_number(rigid, "rigid") < 0:
        raise SettingsError(f"must be a distance, not {shown(rigid)}", setting="rigid")
    entry = format_to_write(os.fsdecode(path))
    if entry.frame_per_file and "*" in where.name:
        where = where.with_name(where.name.replace("*", FOLDER_PADDING))
    writer: Writer = load(entry, entry.writer, "written", where)
    if velocities is not None and not entry.holds_velocities:
        users = titles_of(lambda other: other.holds_velocities)
        raise SettingsError(
            f"velocities can be written to {users} only; leave them out, or write a separate file",
            code="setting-unsupported",
            path=where,
        )
    if rigid and (velocities is not None or len(sequence.runs) > 1 or motion is not None):
        reason = (
            "connectivity that changes"
            if len(sequence.runs) > 1
            else "velocities"
            if velocities is not None
            else "a motion"
        )
        raise SettingsError(
            f"writes static shapes under moving nodes, which cannot have {reason}; leave one out",
            code="conflicting-settings",
            path=where,
            setting="rigid",
        )
    asked: dict[str, Any] = {"web": web, "quantize": quantize, "meshopt": meshopt, "straight": straight, "rigid": rigid}
    asked["motion"] = motion
    for name in (name for name, value in asked.items() if value and name not in entry.write_options):
        raise misplaced(name, _users(name), where)
    unwritten: tuple[str, ...] = ()
    is_carried = scene == "keep" and carries_scene_of(sequence, entry)
    moving = next((name for name in ("web", "quantize", "rigid") if asked[name]), None)
    if is_carried and moving is not None:
        unwritten = (f"the scene of the file is left out: {moving} would move its nodes",)
    elif is_carried:
        write_scene: Callable[..., tuple[str, ...] | InputError] = load(entry, WRITE_SCENE, "written", where)
        options = {"fps": fps, "velocities": velocities, "progress": progress}
        options |= {name: asked[name] for name in ("meshopt", "straight", "rigid", "motion")}
        with _scene_errors():
            found = write_scene(
                sequence, sequence.carried, entry, where, overwrite=overwrite, isolate=isolate, **options
            )
        if not isinstance(found, InputError):
            return found
        unwritten = (f"the scene of the file is left out: {found.message}",)
    if asked.pop("web"):
        # This writer always looks for rigid parts, so `rigid` need not be set.
        asked |= {"quantize": True, "meshopt": True}
    if len(sequence.runs) > 1 and not entry.holds_runs:
        able = extensions_of(lambda item: item.holds_runs)
        frame = sequence.runs[0].frame_count
        raise InputError(
            f"{entry.title} cannot hold connectivity that changes; write {able}",
            code="connectivity-changes",
            path=where,
            frame=frame,
            setting="frames",
            purpose="to choose frames of one connectivity",
        )
    told_of_cells: list[str] = []
    whole = sequence if entry.holds_cells else surface_of(sequence, told_of_cells)
    placed = whole if entry.holds_transforms else bake_transforms(whole)
    rate = sequence.fps if fps is None else fps
    asked["looks_of"] = sequence if looks_of is None else looks_of
    output = Output(path=where, rate=rate, overwrite=overwrite, velocities=velocities, progress=progress, **asked)
    objects = sequence.runs[0].objects
    empty = ", ".join(item.name for item in objects if not item.vertex_count and not entry.holds_nothing)
    with naming_file(where):
        rounded: tuple[str, ...] = ()
        if entry.times != "exact":
            start = float(sequence.times[0]) if entry.starts_at_zero else 0.0
            rounded = times_kept(sequence.times, entry.times, title=entry.title, start=start)
        lost = (*unwritten, *rounded, *writer(placed, output), *told_of_cells)
    if not entry.holds_fields and (names := output.fields_met | {one.name for one in whole.runs[0].fields}):
        lost = (*lost, f"fields not kept: {', '.join(sorted(names))}")
    if velocities is not None and any(map(is_velocity, whole.runs[0].fields)):
        lost = (*lost, f"the velocities of the motion are written in place of the field {VELOCITIES!r}")
    return (*lost, f"objects without vertices are lost: {empty}") if empty else lost


@contextmanager
def _scene_errors() -> Iterator[None]:
    """Add to errors about a damaged scene the setting that leaves the scene out."""
    try:
        yield
    except LimitError:
        raise
    except CorruptFileError as error:
        remedy = {"setting": "scene", "value": "drop", "purpose": "to write the meshes alone"}
        raise CorruptFileError(**error.fields() | remedy) from error


def carries_scene_of(sequence: MeshSequence, entry: Format) -> bool:
    """Return whether a sequence comes from a `.pdeanim` file that carries a scene of a format."""
    with _scene_errors():
        return entry.carrier is not None and sequence.carried is not None and sequence.carried.family == entry.name


def _users(name: str) -> str:
    """Return the titles of formats that have an option."""
    return titles_of(lambda entry: name in (*entry.options, *entry.write_options))


def misplaced(name: str, users: str, path: str | Path) -> SettingsError:
    """Return the error about an option that is given for a format that does not use it."""
    return SettingsError(f"is for {users}; leave it out", code="setting-unsupported", path=path, setting=name)


def open_pdeanim(path: Path | RemoteFile, *, fps: float | None) -> MeshSequence:
    """Open an animation: the frames of the sequence that it was encoded from.

    Raises
    ------
    SettingsError
        If `fps` is given: the file stores its own times.
    CorruptFileError
        If the file is damaged.
    """
    if fps is not None:
        raise SettingsError(
            "is not for .pdeanim files, which store their times; leave it out, or decode at the times you want",
            code="setting-unsupported",
            path=path,
            setting="fps",
        )
    # Imported here so that the command line starts without it.
    from pdecodec.codec.opening import open_animation

    return open_animation(path.address if isinstance(path, RemoteFile) else path)
