"""Carry the scene around the motion in a `.pdeanim` file, and write the motion back onto it.

A carrier holds the files of the source (``files/...``) without the arrays that the `.pdeanim` file codes, and
``cuts``, a JSON text that lists the removed arrays. A :class:`Family` of formats cuts and fills the files. The
filled files are an original like any other, onto which :func:`pdecodec.formats.write_onto` writes the motion.
"""

from __future__ import annotations

import json
import os
import re
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray

from pdecodec.codec.sections.scene import CUTS, Carrier, name_fault
from pdecodec.codec.source import chosen_limits
from pdecodec.errors import ErrorCode, InputError, damaged
from pdecodec.formats.base.attribute_roles import UV, is_role, reversed_corners
from pdecodec.formats.base.carried_fields import StoredFields
from pdecodec.formats.base.frame_files import FOLDER_PADDING, frames_there, is_frame_pattern
from pdecodec.formats.base.isolated_writing import in_worker
from pdecodec.formats.base.onto import Fitted, match_objects, write_onto
from pdecodec.formats.base.opening import open_sequence
from pdecodec.formats.base.registry import Format, load
from pdecodec.formats.base.transforms import bake_transforms
from pdecodec.mesh.sequence import MeshObject, MeshSequence
from pdecodec.system.whole_output import move_into, output_exists, partial_folder, publish, write_errors

FILES = "files/"
"""Prefix of the names of streams that are files."""

COUNTS, INDICES = "faceVertexCounts", "faceVertexIndices"
"""Names of the arrays of faces that the decoder restores."""

_OF_READING = ("clip", "displacement", "solids")
"""Options for reading the source that a carrier records."""

_BY_LIBRARIES = ("alembic", "usd", "exodus")
"""Formats whose files libraries in other languages parse, which a damaged file can crash."""

_COMPANION_ENDINGS = (
    *(".usd", ".usda", ".usdc", ".mtl", ".mtlx", ".bin", ".png", ".jpg", ".jpeg", ".exr", ".hdr", ".avif", ".webp"),
    *(".ktx2", ".tif", ".tiff", ".tga", ".bmp", ".gif", ".tex", ".m4a", ".mp3", ".wav"),
)
"""Extensions of files that may be written next to an output: layers, materials, images and sounds."""

_SPECIAL = re.compile(r"\.|(con|prn|aux|nul|com\d|lpt\d) *(\.|$)", re.IGNORECASE)
"""Pattern of names that files next to an output must not have: hidden files and devices of Windows."""

OF_OUTPUT = frozenset({"output-exists", "output-unwritable", "disk-full", "overwrites-input", "interrupted"})
"""Codes of errors that do not concern the scene. After any other error the mesh alone can be written."""


@dataclass(frozen=True)
class Stripped:
    """Files without their coded arrays.

    Attributes
    ----------
    files : dict of str to bytes
        By path relative to the folder of the source; names of others stay as they are in the files.
    root : str
        The file that names the others.
    cuts : dict
        JSON object from which :meth:`Family.fill` restores the arrays, and options with which the file was read:
        ``clip``, ``displacement``, ``solids``.
    contents : dict of str to int
        Things that the coded mesh does not hold, by a noun in the singular, with their numbers.
    companions : tuple of str
        Members of `files` that a written file refers to, and that are therefore written next to it.
    outside : tuple of str
        Files to which members of `files` refer, but that are not in `files`.
    fields : tuple of str
        Names of the fields whose values were cut: :func:`write_onto` writes them anew, like the motion.
    """

    files: dict[str, bytes]
    root: str
    cuts: dict[str, Any]
    contents: dict[str, int]
    companions: tuple[str, ...] = ()
    outside: tuple[str, ...] = ()
    fields: tuple[str, ...] = ()


def is_carried_name(name: str) -> bool:
    """Return whether a carrier can hold a file with this path relative to the main file."""
    return name_fault(f"{FILES}{name}") is None


def is_companion_name(name: str) -> bool:
    """Return whether a carried file of this path may come to lie next to an output.

    Only layers, libraries of materials, images and sounds do: a file must not bring scripts or settings of programs.
    Hidden files mean something to programs, this one too, and some names are devices on Windows.
    """
    has_place = name.lower().endswith(_COMPANION_ENDINGS)
    return has_place and is_carried_name(name) and not any(map(_SPECIAL.match, name.split("/")))


def arrays_of(item: MeshObject, *, exact_uvs: bool = True) -> Iterator[tuple[tuple[str, str], NDArray[Any]]]:
    """Yield the arrays of an object that the decoder restores: faces and attributes, also with faces reversed.

    They include UVs if the decoder returns these to the last bit, `exact_uvs`.
    """
    faces = item.connectivity
    order = reversed_corners(faces.face_counts)
    yield (COUNTS, ""), faces.face_counts
    yield (INDICES, ""), faces.face_indices
    yield (INDICES, "turned"), faces.face_indices[order]
    for one in item.attributes:
        if one.labels or one.name == "transform" or (is_role(one, UV) and not exact_uvs):
            continue
        yield (one.name, "values"), one.values
        if one.indices is not None:
            yield (one.name, "indices"), one.indices
        if one.domain == "corner":
            turned = one.values if one.indices is None else one.indices
            yield (one.name, "turned"), turned[order]


@contextmanager
def open_fields(path: Path, sequence: MeshSequence, names: Collection[str]) -> Iterator[StoredFields]:
    """Open a file of a scene, to fill its fields with those of a sequence."""
    placed = bake_transforms(sequence)
    with open_sequence(path, skip_unsupported=True) as original:
        yield StoredFields(placed, original, match_objects(placed, original, path)[0], names)


class Family(Protocol):
    """How the files of a format are cut and filled: a class that the format's entry names."""

    def strip(
        self, original: Any, source: Path, fits: Sequence[Fitted], *, exact_uvs: bool, fields: StoredFields
    ) -> Stripped | None:
        """Remove the arrays of coded objects from the files of an open sequence; None if nothing else remains.

        `exact_uvs` says whether the decoder returns texture coordinates to the last bit; `fields` are the coded
        fields.
        """

    def fill(self, folder: Path, cuts: dict[str, Any], sequence: MeshSequence, suffix: str) -> None:
        """Fill the files in a folder from a decoded sequence. Arrays that the motion replaces may hold any values.

        `cuts` also has the members ``root`` and ``companions``. They may be changed, as for an output with `suffix`.
        """


class CarriedFile:
    """The scene of an open file, which an encoder may carry.

    Parameters
    ----------
    entry : Format
    path : pathlib.Path
    original : MeshSequence
        Referred to weakly: what is made of it keeps it.
    """

    family = None

    def __init__(self, entry: Format, path: Path, original: MeshSequence) -> None:
        self._entry, self._path, self._original = entry, path, weakref.ref(original)

    def of_some_objects(self) -> CarriedFile:
        """Return itself: shapes that are not coded stay in the carrier."""
        return self

    def carrier(self, sequence: MeshSequence, *, exact_uvs: bool, fields: Collection[str]) -> Carrier | None:
        """Return the carrier for a sequence read from the file; None if the file holds only its mesh.

        Raises
        ------
        InputError
            If the motion could not be written back.
        """
        original = self._original()
        if original is None:
            return None
        family: Family = load(self._entry, self._entry.carrier, "read", self._path)()
        fits, _ = match_objects(sequence, original, self._path)
        with _damage_named():
            found = family.strip(
                original, self._path, fits, exact_uvs=exact_uvs, fields=StoredFields(sequence, original, fits, fields)
            )
        if found is None:
            return None
        contents = {noun: count for noun, count in found.contents.items() if count}
        if not contents and all(one.fate != "dropped" for one in original.contents):
            return None
        cuts = json.dumps(
            {**found.cuts, "root": found.root, "companions": found.companions, "fields": found.fields},
            separators=(",", ":"),
        ).encode()
        files = {CUTS: cuts, **{f"{FILES}{name}": data for name, data in found.files.items()}}
        return Carrier.of(self._entry.name, contents.items(), found.outside, files)


def write_scene(
    sequence: MeshSequence,
    carrier: Carrier,
    entry: Format,
    where: Path,
    *,
    overwrite: bool,
    isolate: bool = False,
    **options: Any,
) -> tuple[str, ...] | InputError:
    """Write the scene that a file carries with a sequence's motion.

    Parameters
    ----------
    sequence : MeshSequence
        Of all objects of the file.
    carrier : Carrier
    entry : Format
        Of the carrier's family.
    where : pathlib.Path
        File, or for formats of one file per frame a pattern or a folder. The other files of the scene are written next
        to it; identical files that exist there already are kept.
    overwrite : bool
    isolate : bool
        Parse the files in a worker process, if a library does it.
    **options
        Of :func:`pdecodec.formats.write_onto`.

    Returns
    -------
    tuple of str, or InputError
        A line for each thing that is not kept. If the motion does not fit the scene, nothing is written, and the
        result is the error.
    """
    files = carrier.files(chosen_limits(None).max_memory)
    with ExitStack() as stack:
        place = stack.enter_context(_frames_in_folder(where, entry))
        # Placeholders of frame numbers would have a meaning in names of folders, too.
        folder = stack.enter_context(partial_folder(place.with_name(where.name.replace("#", "_"))))
        stack.enter_context(write_errors(where))
        try:
            cuts = _cuts_of(files)
            names = [name.removeprefix(FILES) for name in files if name.startswith(FILES)]
            for name in names:
                path = folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(files[FILES + name])
            if cuts["root"] not in names or not set(cuts["companions"]) <= set(names):
                raise damaged("the scene does not hold all of its files")
            if absent := set(cuts.get("fields", ())) - {one.name for one in sequence.fields}:
                raise InputError(f"it needs the field {min(absent)!r}", code="object-missing")
            write = partial(in_worker, write_filled) if isolate and entry.name in _BY_LIBRARIES else write_filled
            written = Written(*write(sequence, entry, folder / place.name, where, cuts, options))
            if not set(written.companions) <= set(names) or Path(written.original).name != written.original:
                raise damaged("the scene is damaged: its files have other names")
        except InputError as error:
            if error.code in OF_OUTPUT:
                raise error.placed(path=where) from error
            return error
        (folder / written.original).unlink()
        for name in set(names) - {written.root, *written.companions}:
            (folder / name).unlink()
        _publish(folder, place, written.companions, overwrite=overwrite)
    return written.notices


class Written(NamedTuple):
    """Result of :func:`write_filled`: the original's old and new name, names of files next to it, and notices."""

    root: str
    original: str
    companions: Sequence[str]
    notices: tuple[str, ...]


def write_filled(
    sequence: MeshSequence, entry: Format, place: Path, where: Path, cuts: dict[str, Any], options: Mapping[str, Any]
) -> Written:
    """Fill the files of a scene in a folder, and write them with the motion to `place`; `where` is the output."""
    folder = place.parent
    family: Family = load(entry, entry.carrier, "written", where)()
    with _damage_named():
        family.fill(folder, cuts, sequence, where.suffix)
    if bad := next((name for name in cuts["companions"] if not is_companion_name(name)), None):
        raise damaged(f"the scene holds a file {bad!r}, a name that it may not have")
    if place.name in cuts["companions"]:
        raise InputError(
            "is the name of a file that the scene consists of; give another name",
            code=ErrorCode.OVERWRITES_INPUT,
            path=where,
        )
    # The output may have the name of the original.
    root = (folder / cuts["root"]).rename(free_name(folder / f"original{Path(cuts['root']).suffix}", place.name))
    reading: dict[str, Any] = {name: str(cuts[name]) for name in _OF_READING if name in cuts and name in entry.options}
    notices = write_onto(sequence, root, place, is_filled=True, **reading, **options)
    return Written(cuts["root"], root.name, cuts["companions"], notices)


def free_name(path: Path, *others: str) -> Path:
    """Return a free path in the same folder, with a name that differs from some others."""
    while os.path.lexists(path) or path.name in others:
        path = path.with_name(f"_{path.name}")
    return path


def _cuts_of(files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the list of removed arrays in a carrier's files."""
    try:
        found = json.loads(files[CUTS])
        names = (found["root"], *found["companions"], *found.get("fields", ()))
        if all(isinstance(name, str) for name in names):
            return dict(found)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError):
        pass
    raise damaged("the scene does not say what was cut out of it")


@contextmanager
def _damage_named() -> Iterator[None]:
    """Convert exceptions that a damaged or hostile carrier causes in a family's code to an error of one line."""
    try:
        yield
    except (
        *(LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RuntimeError, StopIteration, OSError),
        MemoryError,
    ) as error:  # fmt: skip
        # Other errors tell what the code did, not what the carrier has.
        reason = str(error) if isinstance(error, (ValueError, OSError)) else ""
        is_plain = reason and "\n" not in reason
        raise damaged(f"the scene is damaged{f' ({reason})' if is_plain else ''}") from error


@contextmanager
def _frames_in_folder(where: Path, entry: Format) -> Iterator[Path]:
    """Yield the output path; for a folder, make it and yield the pattern of its frames."""
    if not entry.frame_per_file or is_frame_pattern(where) or (where.suffix and not where.is_dir()):
        yield where
        return
    is_new = not where.exists()
    with write_errors(where):
        where.mkdir(exist_ok=True)
    try:
        yield where / f"{where.resolve().name}.{FOLDER_PADDING}{entry.extensions[0]}"
    except BaseException:
        if is_new:
            with suppress(OSError):
                where.rmdir()
        raise


def _publish(folder: Path, place: Path, companions: Sequence[str], *, overwrite: bool) -> None:
    """Move the files written in a folder to its parent: first companions, except those that exist there
    unchanged, then the outputs.
    """
    target = place.parent
    outputs = [one.name for one in sorted(folder.iterdir()) if one.is_file() and one.name not in companions]
    taken = [] if overwrite else [name for name in outputs if (target / name).exists()]
    if taken:
        raise output_exists(target / taken[0])
    moved = []
    for name in companions:
        there = target / name
        if not there.parent.resolve().is_relative_to(target.resolve()):
            raise InputError(
                "is a link out of the folder, and the scene has files below it; write to another folder",
                code=ErrorCode.OUTPUT_UNWRITABLE,
                path=there.parent,
            )
        if not os.path.lexists(there):
            moved.append(name)
        elif not there.is_file() or there.read_bytes() != (folder / name).read_bytes():
            raise InputError(
                "exists already, and is not the file of that name which the scene consists of; write to another folder",
                code=ErrorCode.OUTPUT_EXISTS,
                path=there,
            )
    for name in moved:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        move_into(folder / name, target / name, overwrite=False)
    stale = {one.name for one in frames_there(place)} - set(outputs) if is_frame_pattern(place) else set()
    publish(folder, outputs, overwrite=overwrite, remove=sorted(stale))
