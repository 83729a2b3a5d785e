"""The decoder: a `.pdeanim` file as a mesh sequence with positions at any time.

The native core decodes (`core/decode/animation.hpp`); this module adds Python's times, settings and errors.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec import _core
from pdecodec.codec.container import (
    BESIDE_MOTION,
    SCENE_SECTION,
    SECTION_KINDS,
    Section,
    container_pieces,
    notices_of_unknown,
)
from pdecodec.codec.paper_form import PaperForm, paper_form
from pdecodec.codec.sections.attributes import DOMAINS
from pdecodec.codec.sections.description import decode_remarks
from pdecodec.codec.sections.fields import computed_words, field_of
from pdecodec.codec.sections.groups import TIME_BASES, GroupEntry
from pdecodec.codec.sections.reference import ReferenceFrame
from pdecodec.codec.sections.space_basis import SPACE_KINDS, SpaceBasis, SpaceForm, decode_space_basis
from pdecodec.codec.source import DecodeLimits, Source, naming_file_of, open_core, open_source
from pdecodec.errors import CorruptFileError, InputError, LimitError, SettingsError
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence, check_frame_range
from pdecodec.mesh.times import OUTSIDES, Outside, times_inside
from pdecodec.system.arguments import as_integer, as_numbers, shown

if TYPE_CHECKING:
    from pdecodec.codec.sections.scene import Carrier

Array = TypeVar("Array")

POSITIONS, VELOCITIES, ACCELERATIONS = 0, 1, 2
"""Quantities, by the core's numbers."""


def _writable(out: Any) -> NDArray[Any]:
    """Return the array itself, or a numpy view of another library's array; raise SettingsError if it is read-only."""
    if isinstance(out, np.ndarray):
        return out
    try:
        return _core.writable_view(out)
    except TypeError as error:
        raise SettingsError(
            "the array to write to must be a numpy array, or export float32 in main memory through DLPack"
        ) from error


def _as_bytes(array: NDArray[Any]) -> NDArray[np.uint8]:
    return array.reshape(-1).view(np.uint8)


class Animation(MeshSequence):
    """A `.pdeanim` file: a mesh sequence, and a mesh at any time between its first and its last frame.

    Made by :func:`pdecodec.open`. Opening reads only headers, with the vertex counts; the mesh, attributes and
    groups of frames are decoded on first use. At the time of a frame, every method returns the same bits. Before
    each frame in :attr:`jumps` the motion is discontinuous: it is a straight line from the frame before.

    Any number of threads may use it (they take turns), and any of them may close it: running calls finish, later
    ones raise InputError. It survives a fork (the child decodes anew), and is pickled by its path or with its bytes;
    an animation of a file object cannot be pickled.
    """

    def __init__(
        self,
        source: Source,
        limits: DecodeLimits,
        *,
        core: _core.Animation | None = None,
        run: int | None = None,
        first_frame: int = 0,
    ) -> None:
        self.path = source.name
        self._source, self._limits, self._run = source, limits, run
        self._owns_source = run is None
        self._core = core or open_core(source, limits)
        self.notices = notices_of_unknown(stored.type for stored in self._core.sections)
        self._file_bytes = self._core.file_bytes
        self._first_frame = first_frame
        self.times, self.fps = self._core.times, self._core.fps
        self.jumps = tuple(self._core.jumps)
        self._describe()
        size = 12 * self.position_count
        if limits.max_output is not None and size > limits.max_output:
            raise LimitError(
                f"declares {self.frame_count} frames of {self.position_count / self.frame_count:.10g} vertices, {size} "
                f"bytes of positions; the output limit is {limits.max_output}",
                code="output-limit",
                path=self.path,
                limit="max_output",
            )

    def _describe(self) -> None:
        """Read everything that is known before decoding."""
        self._vertex_counts = self._core.vertex_counts

    def _naming_the_file(self) -> AbstractContextManager[None]:
        return naming_file_of(self._source, self._first_frame)

    @property
    def vertex_count(self) -> int:
        return sum(self._vertex_counts)

    @cached_property
    def objects(self) -> tuple[MeshObject, ...]:  # type: ignore[override]  # decoded when it is first needed
        with self._naming_the_file():
            attributes = self._core.attributes()
            return tuple(
                MeshObject(
                    item.name,
                    item.connectivity,
                    tuple(Attribute(one.name, DOMAINS[one.domain], one.values, one.indices, one.labels) for one in own),
                )
                for item, own in zip(self.meshes, attributes, strict=True)
            )

    @cached_property
    def meshes(self) -> tuple[MeshObject, ...]:
        """The objects without their attributes; reading them needs no reference frame."""
        with self._naming_the_file():
            parts, names = self._core.connectivity(), self._core.names()
        return tuple(
            MeshObject(name, Connectivity(vertices, *arrays))
            for name, vertices, arrays in zip(names, self._vertex_counts, parts, strict=True)
        )

    def sections_of_run(self, run: int) -> list[_core.Section]:
        """Return offsets and lengths of a run's own sections in the file."""
        return self._core.run_sections(run)

    @cached_property
    def stored_fields(self) -> list[_core.StoredField]:
        """Headers of section FLDS."""
        with self._naming_the_file():
            return self._core.stored_fields()

    @cached_property
    def fields(self) -> tuple[Field, ...]:  # type: ignore[override]  # read when it is first needed
        """Values that change in time; :meth:`field` evaluates them, :meth:`read_field` reads them."""
        return tuple(map(field_of, self.stored_fields))

    def _field_number(self, name: str) -> tuple[Field, int]:
        field = self.field_named(name)
        return field, self.fields.index(field)

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        values = np.empty(field.shape(stop - start, self.meshes), field.dtype)
        with self._naming_the_file():
            self._core.read_field(self.fields.index(field), start, stop - start, _as_bytes(values))
        return values

    def field(
        self,
        name: str,
        times: ArrayLike,
        *,
        object: int | None = None,
        out: NDArray[Any] | None = None,
        outside: Outside = "clamp",
        derivative: int = 0,
    ) -> NDArray[Any]:
        """Return the values of a field at one time or at several.

        Between frames, floats follow the spline that positions follow. Whole numbers and flags, and values near which
        one is not finite, are those of the frame before.

        Parameters
        ----------
        name : str
        times : float or (n,) array [s]
            In any order.
        object : int, optional
            Index of one object, whose rows alone are returned: none if it does not have the field. Default: all.
        out : array of the field's type, optional
            Written and returned.
        outside : {"clamp", "loop", "refuse"}
            As in :meth:`positions`.
        derivative : {0, 1, 2}
            1 and 2: the derivatives of the spline [units of the field / s, / s^2], of fields of floats; NaN near a
            value that is not finite.

        Returns
        -------
        (rows,), (rows, components), (n, rows) or (n, rows, components) array

        Raises
        ------
        InputError
            If there is no such field.
        SettingsError
            If `times` are not numbers, a time lies outside and that is refused, there is no such object, the field has
            no derivative, or `out` has another shape or type.
        CorruptFileError
            If a group that is needed is damaged.
        """
        field, number = self._field_number(name)
        given = as_numbers(times, "times")
        asked = given if given.ndim else given[np.newaxis]
        inside = self._inside(asked, outside)
        if object is not None:
            as_integer(object, "object", 0, len(self.meshes) - 1)
        if as_integer(derivative, "derivative", 0, 2) and field.is_exact:
            raise SettingsError(
                f"field {name!r} is of type {field.dtype}, which has no derivative", setting="derivative"
            )
        shape = list(field.shape(asked.size, self.meshes))
        if object is not None:
            shape[1] = field.row_counts(self.meshes)[object]
        wanted = tuple(shape if given.ndim else shape[1:])
        found = np.empty(wanted, field.dtype) if out is None else out
        if found.shape != wanted or found.dtype != field.dtype or not found.flags.writeable:
            raise SettingsError(
                f"the array to write to must be {field.dtype} {wanted}, not {found.dtype} {found.shape}"
            )
        target = found if found.flags.c_contiguous else np.empty(wanted, field.dtype)
        known = inside if not derivative or outside == "loop" else asked
        with self._naming_the_file():
            self._core.evaluate_field(number, known, derivative, object, _as_bytes(target))
        if target is not found:
            found[...] = target
        return found

    @cached_property
    def _remarks(self) -> dict[str, Any]:
        with self._naming_the_file():
            data = self._core.remarks()
            return decode_remarks(data, self._limits.max_memory) if data else {}

    @cached_property
    def carried(self) -> Carrier | None:  # type: ignore[override]  # read when it is first needed
        """The scene around the motion that the file carries, compressed, with its limit; None if there is none."""
        stored = next((one for one in self._core.sections if one.type == SCENE_SECTION), None)
        if stored is None or stored.length == 0 or self._run is not None:
            return None
        from pdecodec.codec.sections.scene import decode_scene  # files without a scene open faster

        with self._naming_the_file():
            self._core.check_section(SCENE_SECTION)
            return decode_scene(self._source.read(stored.offset, stored.length))

    @property
    def metadata(self) -> dict[str, str]:  # type: ignore[override]  # read when it is first needed
        found = self._remarks.get("metadata", {})
        return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}

    def __repr__(self) -> str:
        return f"{super().__repr__()[:-1]}, {self._file_bytes:,} bytes>"

    @property
    def _object_count(self) -> int:
        return len(self._vertex_counts)

    def close(self) -> None:
        self._core.close()
        if self._owns_source:
            self._source.close()

    def __reduce__(self) -> tuple[Any, ...]:
        source = self._source.origin or self._source.file
        if not isinstance(source, str | bytes):
            raise InputError(
                "was opened as a file object, which cannot be pickled; open it by its path", path=self.path
            )
        return _reopened, (type(self), source, self._limits, self._run)

    def motion_alone(self) -> bytes:
        """Return a file of the same motion without remarks, attributes, fields, scene and unknown sections.

        Positions stay the same.

        Raises
        ------
        CorruptFileError
            If the file is damaged.
        """
        sections = []
        for stored in self._core.sections:
            if stored.type not in SECTION_KINDS or stored.type in (*BESIDE_MOTION, "META", "ATTR"):
                continue
            self.check_section(stored.type)
            sections.append(Section(stored.type, self._source.read(stored.offset, stored.length)))
        return b"".join(container_pieces(sections))

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        return self.sample(self.times[start:stop])

    @overload
    def positions(self, times: ArrayLike, *, out: None = None, outside: Outside = "clamp") -> Float32Array: ...
    @overload
    def positions(self, times: ArrayLike, *, out: Array, outside: Outside = "clamp") -> Array: ...
    def positions(self, times: ArrayLike, *, out: Any = None, outside: Outside = "clamp") -> Any:
        """Return positions at one time or at several, optionally in the caller's array.

        Parameters
        ----------
        times : float or (n,) array [s]
            In any order.
        out : (vertices, 3) or (n, vertices, 3) float32, optional
            Written and returned; after an error its values are undefined. A numpy array, or any other array in main
            memory that DLPack can export, such as a torch tensor, which then needs no copy.
        outside : {"clamp", "loop", "refuse"}
            Before the first and after the last frame: that frame, the clip again, or an error.

        Returns
        -------
        (vertices, 3) or (n, vertices, 3) float32 [scene units]

        Raises
        ------
        SettingsError
            If `times` are not numbers, a time lies outside and that is refused, or `out` has another shape or dtype or
            is read-only.
        CorruptFileError
            If a group that is needed is damaged.
        """
        return self._evaluated(POSITIONS, times, out, outside)

    @overload
    def sample(self, times: ArrayLike, *, out: None = None, outside: Outside = "clamp") -> Float32Array: ...
    @overload
    def sample(self, times: ArrayLike, *, out: Array, outside: Outside = "clamp") -> Array: ...
    def sample(self, times: ArrayLike, *, out: Any = None, outside: Outside = "clamp") -> Any:
        """Return positions at several times, (n, vertices, 3), as :meth:`positions` of a list."""
        asked = as_numbers(times, "times")
        if asked.ndim == 0:
            raise SettingsError("must be a list of numbers; `positions` also takes a single time", setting="times")
        return self._evaluated(POSITIONS, asked, out, outside)

    def _evaluated(self, quantity: int, times: ArrayLike, out: Any, outside: Outside) -> Any:
        """Evaluate a quantity at one time, without an axis of times, or at several."""
        given = as_numbers(times, "times")
        asked = given if given.ndim else given[np.newaxis]
        return self._of_core(quantity, asked, self._inside(asked, outside), out, outside, is_one=not given.ndim)

    def _of_core(
        self, quantity: int, asked: Float64Array, inside: Float64Array, out: Any, outside: Outside, *, is_one: bool
    ) -> Any:
        # Outside the clip, the core itself returns zero velocities.
        known = inside if quantity == POSITIONS or outside == "loop" else asked
        whole = (known.size, self.vertex_count, 3)
        shape = whole[1:] if is_one else whole
        target = np.empty(shape, np.float32) if out is None else _writable(out)
        if target.shape != shape or target.dtype != np.float32 or not target.flags.writeable:
            kind = "" if target.flags.writeable else "read-only "
            raise SettingsError(
                f"the array to write to must be float32 {shape}, not {kind}{target.dtype} {target.shape}"
            )
        found = target if target.flags.c_contiguous else np.empty(shape, np.float32)
        try:
            self._core.evaluate(quantity, known, None, found.reshape(whole))
        except Exception:
            # Only entered after an error, because entering takes longer than decoding a small frame.
            with self._naming_the_file():
                raise
        if found is not target:
            target[:] = found
        return target if out is None else out

    @overload
    def velocities(self, times: ArrayLike, *, out: None = None, outside: Outside = "clamp") -> Float32Array: ...
    @overload
    def velocities(self, times: ArrayLike, *, out: Array, outside: Outside = "clamp") -> Array: ...
    def velocities(self, times: ArrayLike, *, out: Any = None, outside: Outside = "clamp") -> Any:
        """Return the velocity of every vertex at one time or at several: the exact derivative of the positions.

        Residuals change at constant speed from one frame to the next; at a frame, the speed to the next one counts.
        Where positions are clamped outside the clip, velocities are 0.

        Parameters
        ----------
        times : float or (n,) array [s]
        out : (vertices, 3) or (n, vertices, 3) float32, optional
        outside : {"clamp", "loop", "refuse"}
            All as in :meth:`positions`.

        Returns
        -------
        (vertices, 3) or (n, vertices, 3) float32 [scene units / s]

        Raises
        ------
        SettingsError, CorruptFileError
            As in :meth:`positions`.
        """
        return self._evaluated(VELOCITIES, times, out, outside)

    @overload
    def accelerations(self, times: ArrayLike, *, out: None = None, outside: Outside = "clamp") -> Float32Array: ...
    @overload
    def accelerations(self, times: ArrayLike, *, out: Array, outside: Outside = "clamp") -> Array: ...
    def accelerations(self, times: ArrayLike, *, out: Any = None, outside: Outside = "clamp") -> Any:
        """Return the acceleration of every vertex: the exact second derivative of the positions; residuals have none.

        Parameters, shapes and errors are those of :meth:`velocities`; the unit is [scene units / s^2].
        """
        return self._evaluated(ACCELERATIONS, times, out, outside)

    def _inside(self, asked: Float64Array, outside: Outside) -> Float64Array:
        first, last = self._ends
        is_known = isinstance(outside, str) and outside in OUTSIDES
        if is_known and asked.size == 1 == asked.ndim and first <= asked.item() <= last:
            return asked
        if asked.ndim != 1 or np.isnan(asked).any():
            raise SettingsError("must be a number or a list of numbers", setting="times")
        return times_inside(asked, first, last, outside)

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return float(self.times[0]), float(self.times[-1])

    def coefficients(self, group: int) -> PaperForm:
        """Return the coefficients of one group as the paper writes them (Eqs. 17 and 18), and the functions
        that they multiply.

        Parameters
        ----------
        group : int
            0 to ``info()["groups"] - 1``.

        Raises
        ------
        SettingsError
            If the file's functions are not the paper's 32, or no group of this number.
        """
        with self._naming_the_file():
            groups = self._core.groups
        if not 0 <= as_integer(group, "group") < len(groups):
            raise SettingsError(
                f"there is no group {shown(group)}; the file has {len(groups)}, from 0 on", code="unknown-name"
            )
        entry = groups[group]
        reference, space = self.reference_and_space()
        with self._naming_the_file():
            values = self._core.coefficients(group)
        return paper_form(
            reference, space, values, self.times[entry.first : entry.first + entry.frames], alpha=entry.alpha,
            functions=entry.functions, first_frame=entry.first,
        )  # fmt: skip

    @property
    def group_edges(self) -> list[int]:
        """First frame of every group of frames, followed by the number of frames. Groups are what is read and
        decoded as a unit.
        """
        with self._naming_the_file():
            return [*(group.first for group in self._core.groups), self.frame_count]

    @property
    def groups(self) -> list[GroupEntry]:
        """The groups of frames, without the positions of their bytes."""
        with self._naming_the_file():
            found = self._core.groups
        return [
            GroupEntry(
                frames=group.frames,
                functions=group.functions,
                basis=TIME_BASES[group.basis],
                single=False,
                step=group.step,
                alpha=group.alpha,
            )
            for group in found
        ]

    @property
    def residual_step(self) -> float:
        """Unit of residuals [scene units]."""
        with self._naming_the_file():
            return self._core.model.residual_step

    def reference_and_space(self) -> tuple[ReferenceFrame, SpaceBasis]:
        """The reference frame and the functions of space that every group is coded with."""
        with self._naming_the_file():
            model, frame, still = self._core.model, self._core.reference(), self._core.still_vertices
            form = SpaceForm(
                SPACE_KINDS[model.kind], model.points, model.functions, model.threshold, model.rate, model.is_affine
            )
            space = decode_space_basis(form, model.layout, self.meshes, frame.grid, ties=frame.ties, still=still)
            shape = ReferenceFrame(
                frame.grid, np.array(frame.origin), frame.step, frame.is_smoothed, ties=frame.ties, still=still
            )
            return shape, space

    @property
    def sections(self) -> dict[str, int]:
        """Bytes of each section, and of header and table together as ``"container"``; the sum is the size of
        the file.
        """
        with self._naming_the_file():
            sizes = {section.type: section.length for section in self._core.sections}
            # A run has no header of its own.
            container = 0 if self._run is not None else self._core.file_bytes - sum(sizes.values())
            return {"container": container, **sizes}

    def info(self) -> dict[str, Any]:
        """Return the facts in the headers as a JSON object: sections, model, settings, and why the encoder
        chose this model.
        """
        with self._naming_the_file():
            groups, space_kind, has_ties = self._core.groups, self._core.model.kind, self._core.ties_vertices
            still = self._core.still_vertices
        frames = [group.frames for group in groups]
        return {
            **self._facts(),
            "time_bases": sorted({TIME_BASES[group.basis] for group in groups}),
            "space_basis": SPACE_KINDS[space_kind],
            "functions_of_time": max(group.functions for group in groups),
            "groups": len(groups),
            "group_frames": [min(frames), max(frames)],
            "tied_vertices": has_ties,
            "still_vertices": int(np.count_nonzero(still)),
            "alternatives": self._remarks.get("alternatives"),
        }

    def _facts(self) -> dict[str, Any]:
        """Return the facts that :meth:`info` reports both for files of one run and for files of several."""
        sections, remarks = self.sections, self._remarks
        file_bytes = sum(sections.values())
        return {
            "file_bytes": file_bytes,
            "ratio": 12 * self.position_count / (file_bytes - sum(sections.get(name, 0) for name in BESIDE_MOTION)),
            "sections": sections,
            "summary": str(remarks.get("summary", "")),
            "generator": str(remarks.get("generator", "")),
            "settings": remarks.get("settings", {}),
            "jumps": list(self.jumps),
            "fields": self.field_facts(),
            **({"scene": self._scene_facts(sections[SCENE_SECTION])} if sections.get(SCENE_SECTION) else {}),
        }

    def _scene_facts(self, stored: int) -> dict[str, Any]:
        """Return what the scene holds; ``error`` if it is damaged, which nothing else depends on."""
        from pdecodec.codec.sections.scene import scene_facts

        try:
            return scene_facts(self.carried, stored) if self.carried is not None else {}
        except CorruptFileError as error:
            return {"bytes": stored, "error": error.message}

    def field_facts(self) -> list[dict[str, Any]]:
        return [
            {
                **facts,
                "range": [stored.smallest, stored.largest],
                "bound": stored.bound,
                "bytes": sum(group.size for group in stored.groups),
                "groups": len(stored.groups),
                **({"computed": words} if (words := computed_words(stored, self.fields)) else {}),
            }
            for facts, stored in zip(super().field_facts(), self.stored_fields, strict=True)
        ]

    @property
    def group_frames(self) -> list[tuple[int, int]]:
        """First frame and end of each group of frames; of a run, counted from the run's first frame."""
        with self._naming_the_file():
            return [(group.first, group.first + group.frames) for group in self._core.groups]

    @property
    def part_decoders(self) -> tuple[Callable[[], object], ...]:
        """Functions that decode parts of the file other than groups of frames: names, faces, reference frame,
        attributes.
        """
        own = self._core

        def naming(decode: Callable[[], object]) -> Callable[[], object]:
            def decoded() -> object:
                with self._naming_the_file():
                    return decode()

            return decoded

        return tuple(map(naming, (own.names, own.connectivity, own.reference, own.attributes)))

    def check_section(self, kind: str) -> None:
        """Check the bytes of one section; raise CorruptFileError if its checksum is wrong."""
        with self._naming_the_file():
            self._core.check_section(kind)

    def check_group(self, group: int) -> None:
        """Check the bytes of one group of frames; raise CorruptFileError if its checksum is wrong."""
        with self._naming_the_file():
            self._core.check_group(group)

    def check_field_group(self, field: int, group: int, *, deep: bool = False) -> None:
        """Check the bytes of one group of a field and, if `deep`, decode it; raise CorruptFileError if one fails."""
        with self._naming_the_file():
            self._core.check_field_group(field, group, deep)

    def verify(self) -> None:
        """Check every byte of the file, and decode every part and every group.

        Raises
        ------
        CorruptFileError
            If a check fails, or a part cannot be decoded.
        """
        with self._naming_the_file():
            self._core.verify()
        _ = self.objects, self._remarks
        self._verify_scene()

    def _verify_scene(self) -> None:
        with self._naming_the_file():
            if self.carried is not None:
                self.carried.files(self._limits.max_memory)


def _reopened(kind: type[Animation], path: str | bytes, limits: DecodeLimits, run: int | None) -> Animation:
    """Open a pickled animation again; an animation of a run then owns its file."""
    source = open_source(path)
    core = open_core(source, limits)
    if run is None:
        return kind(source, limits, core=core)
    animation = kind(source, limits, core=core.open_run(run), run=run, first_frame=core.runs[run].first)
    animation._owns_source = True
    return animation
