"""The encoder: a mesh sequence in, a `.pdeanim` file out, with one group of frames in memory at a time.

The steps: frame 0 becomes the reference frame on a grid (REST). Each group of frames is fitted with functions of
time and of space, which the profile chooses (:mod:`pdecodec.codec.encode.pipeline`,
:mod:`pdecodec.codec.encode.paper`). Their coefficients are quantised and coded (TIME, COEF), and vertices that still
miss the bound get residuals (CORR); :mod:`pdecodec.codec.encode.fit` does this.
:mod:`pdecodec.codec.encode.pipeline` goes from group to group and collects the sections.
"""

from __future__ import annotations

import os
from dataclasses import fields, replace
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NamedTuple, Unpack

from numpy.typing import ArrayLike

from pdecodec.codec.container import SCENE_SECTION, Section
from pdecodec.codec.encode.field.sections import check_field_names
from pdecodec.codec.encode.report import EncodeReport
from pdecodec.codec.presets import PresetName, normal_limit, normals_measured, preset_named, with_preset
from pdecodec.codec.rate_control import check_positive, encode_within, rate_limit
from pdecodec.codec.run_encoder import encode_runs, make_encoder
from pdecodec.codec.sections.scene import Carrier, encode_scene
from pdecodec.codec.settings import DROP, EncodeOptions, EncodeSettings, check_one_target
from pdecodec.errors import InputError, MissingExtraError, SettingsError
from pdecodec.mesh.looks import keep_looks_at_rest
from pdecodec.mesh.rounding import rounding_noticed
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import ArraySequence, MeshSequence, Progress
from pdecodec.system.arguments import as_path
from pdecodec.system.storage import is_address, remote_output
from pdecodec.system.whole_output import check_writable, whole_file

Source = MeshSequence | ArrayLike | str | os.PathLike[str]
"""Source of an encode: a sequence, an array of positions, or the path of a file, which is opened and closed."""


def encode(
    sequence: Source,
    path: str | os.PathLike[str] | None = None,
    settings: EncodeSettings | None = None,
    *,
    rms: float | None = None,
    size: int | None = None,
    preset: PresetName | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Unpack[EncodeOptions],
) -> EncodeReport:
    """Encode a mesh sequence, an array of positions, or a file.

    Give at most one target: `tolerance` or `max_error` (fields of the settings), `rms`, `size`, or a `preset`. For
    `rms`, `size` and the preset "hero" the tolerance is searched (:mod:`pdecodec.codec.rate_control`): the coarsest
    tolerance that keeps the mean error or the error of normals within its limit, or the finest one whose file is
    small enough. It has four digits and is recorded in the file's settings: an encode with it gives the same bytes.

    Parameters
    ----------
    sequence : MeshSequence, (frames, vertices, 3) array [scene units], or path
        An array is one object of points at 24 frames per second (:class:`pdecodec.ArraySequence` takes faces and
        times); a path is opened by :func:`pdecodec.open_sequence`. The sequence is read once from front to back, after
        a look at a few windows of it; for `rms`, `size` and "hero" the search reads it several times. The runs of a
        :class:`pdecodec.ChangingSequence` are read and encoded one after the other; tolerances are relative to the
        diagonal of its first frame. Errors are measured from the float32 positions that the sequence returns;
        `rounding` of the report is their distance from the source's own positions.
    path : path-like, optional
        The `.pdeanim` file, or its address; it appears whole or not at all. Without a path the report has its bytes.
    settings : EncodeSettings, optional
    rms : float, optional
        Largest root mean square vertex distance over all frames, relative to the diagonal of frame 0's bounding box.
    size : int, optional [bytes]
        Largest size of the whole file. At least 99 % is used if file sizes follow the tolerance that closely.
    preset : {"preview", "default", "hero", "archive"}, optional
        Purpose of the file (:data:`pdecodec.codec.presets.PRESETS`): "preview", a tolerance of 5e-3 and effort "fast";
        "default", the default settings; "hero", at most 1e-3, and less until the normals of 99 % of all corners at
        frames are within 2 degrees of the source's; "archive", 1e-5 and effort "best". An effort among the options, or
        one in `settings` other than "default", replaces that of the preset.
    overwrite : bool
        Whether an existing file may be replaced.
    progress : callable, optional
    **options
        Fields of :class:`EncodeSettings`, in place of those of `settings`: ``encode(clip, path, tolerance=1e-4)``.

    Returns
    -------
    EncodeReport
        Describes the file written; if there was a search, `seconds` is its total time.

    Raises
    ------
    InputError
        If positions are not finite, the sequence cannot be read, or the output cannot be written.
    SettingsError
        If settings are out of range, an option is unknown, several targets are given, or no tolerance reaches the
        target.
    """
    known = {item.name for item in fields(EncodeSettings)}
    for name in options:
        if name not in known:
            raise SettingsError(
                f"there is no setting named {name}; there are {', '.join(sorted(known))}", code="unknown-name"
            )
    asked = replace(settings or EncodeSettings(), **options)
    targets = {"preset": preset, "tolerance": asked.tolerance, "max_error": asked.max_error, "rms": rms, "size": size}
    check_one_target(targets)
    chosen = with_preset(asked, preset, keeps_effort="effort" in options)
    limit = rate_limit(rms=rms, size=size)
    again: dict[str, Any] = {"settings": asked, "rms": rms, "size": size, "preset": preset, "effort": chosen.effort}
    if not isinstance(sequence, MeshSequence):
        with _opened(sequence) as opened:
            return encode(opened, path, overwrite=overwrite, progress=progress, **again)
    if path is not None and is_address(path):
        with remote_output(str(path), overwrite=overwrite) as local:
            report = encode(sequence, local, progress=progress, **again)
            return replace(report, path=str(path))
    target = None if path is None else as_path(path)
    if target is not None:
        check_writable(target, overwrite=overwrite)
    scene = _scene_of(sequence, chosen)
    normals = normal_limit(sequence, preset_named(preset))
    limit = normals or limit
    if limit is None:
        return replace(_encode(sequence, chosen, target, scene, overwrite=overwrite, progress=progress), preset=preset)
    measure_normals = normals_measured(sequence, is_free=chosen.order == "free")

    def encode_at(tolerance: float, said: Progress | None) -> EncodeReport:
        found = _encode(sequence, replace(chosen, tolerance=tolerance), None, scene, overwrite=False, progress=said)
        if normals is None:
            return found
        assert found.data is not None  # Without a path the report has the bytes.
        return replace(found, normal_p99=measure_normals(found.data, said))

    report = replace(encode_within(limit, encode_at, progress), size_limit=size, preset=preset)
    if target is None:
        return report
    assert report.data is not None  # Without a path the report has the bytes.
    with whole_file(target, overwrite=overwrite) as partial:
        partial.write_bytes(report.data)
    return replace(report, path=target, data=None)


def _opened(source: ArrayLike | str | os.PathLike[str]) -> MeshSequence:
    if isinstance(source, str | os.PathLike):
        # Imported from the public module, because formats build on the codec and the codec knows no formats.
        from pdecodec import open_sequence

        return open_sequence(source)
    return ArraySequence(source)


def _encode(
    sequence: MeshSequence,
    settings: EncodeSettings,
    path: Path | None,
    scene: _Scene,
    *,
    overwrite: bool,
    progress: Progress | None,
) -> EncodeReport:
    """Encode once, at the bound of the settings."""
    check_field_names(settings, sequence.runs)
    sequence = keep_looks_at_rest(sequence, [name for name, asked in settings.fields.items() if asked == DROP])
    with rounding_noticed() as rounding:
        if isinstance(sequence, ChangingSequence):
            report = encode_runs(sequence, settings, path, scene.sections, overwrite=overwrite, progress=progress)
        else:
            report = make_encoder(sequence, settings, progress).run(path, scene.sections, overwrite=overwrite)
    return replace(report, rounding=rounding.largest, scene=scene.contents, scene_note=scene.note)


class _Scene(NamedTuple):
    """Section SCEN if the scene is kept, its contents, and otherwise the reason why it is not kept."""

    sections: tuple[Section, ...] = ()
    contents: tuple[tuple[str, int], ...] = ()
    note: str = ""


def _scene_of(sequence: MeshSequence, settings: EncodeSettings) -> _Scene:
    """Return the part of the source's scene that the file carries."""
    if settings.scene == "drop" or sequence.carried is None:
        return _Scene()
    if settings.order == "free":
        return _Scene(note="it needs the original order of vertices and faces, and the order is free")
    try:
        carrier: Carrier | None = sequence.carried.carrier(
            sequence,
            exact_uvs=settings.uv_tolerance is None,
            fields=[one.name for one in sequence.fields if settings.fields.get(one.name) != DROP],
        )
    except (InputError, MissingExtraError) as error:
        return _Scene(note=error.message)
    if carrier is None:
        return _Scene()
    return _Scene((Section(SCENE_SECTION, encode_scene(carrier)),), carrier.contents)


def encode_to_size(
    sequence: Source,
    size: int,
    path: str | os.PathLike[str] | None = None,
    settings: EncodeSettings | None = None,
    **options: Unpack[EncodeOptions],
) -> EncodeReport:
    """Encode at the finest tolerance whose file is no larger than `size` [bytes]: :func:`encode` with ``size=``."""
    check_positive("size", size, Integral, "whole number of bytes")
    return encode(sequence, path, settings, size=size, **options)


def encode_to_rms(
    sequence: Source,
    rms: float,
    path: str | os.PathLike[str] | None = None,
    settings: EncodeSettings | None = None,
    **options: Unpack[EncodeOptions],
) -> EncodeReport:
    """Encode at the coarsest tolerance whose mean error is no larger than `rms`: :func:`encode` with ``rms=``."""
    check_positive("rms", rms, Real, "number")
    return encode(sequence, path, settings, rms=rms, **options)
