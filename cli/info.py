"""`pdecodec info` and `pdecodec formats`: show the contents of a file, and list the supported formats."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import (
    byte_size,
    counted,
    print_alternatives,
    print_json,
    print_rows,
    print_table,
    progress_bar,
    ratio,
    say,
    say_notices,
    things,
)
from pdecodec.cli.jobs import standard_input
from pdecodec.cli.options import bytes_of, json_option, loudness_options, read_options, within_limits
from pdecodec.errors import InputError, SettingsError

if TYPE_CHECKING:
    from pdecodec.codec.encode.report import Question
    from pdecodec.mesh.sequence import MeshObject, MeshSequence, Progress


@click.command()
@click.argument("source", metavar="FILE|-")
@read_options
@click.option("--all-frames", is_flag=True, help="Read every frame, to give the bounds of the whole sequence.")
@click.option("--tree", "as_tree", is_flag=True, help="Show objects as a tree of their names.")
@click.option(
    "--why",
    is_flag=True,
    help="Show which alternatives the encoder of a .pdeanim file tried and what each would have cost. Without "
    "the record of encode --why, the decoded file is encoded again to find out.",
)
@within_limits
@loudness_options
@json_option
def info(
    *, source: str, all_frames: bool, as_tree: bool, why: bool, as_json: bool, skip_unsupported: bool, **reading: Any
) -> None:
    """Show what a mesh sequence or a .pdeanim file contains.

    FILE may be - for standard input. The output lists objects, faces, frames, times, attributes and bounds, and
    whether connectivity is constant. If it changes, the output gives the first frame that changes it, the number of
    runs (frames of one connectivity), and the objects of the first run. For a .pdeanim file, sections, settings and the
    model are listed too; its positions and attributes are decoded only with --all-frames.
    """
    from pdecodec.formats.base.choosing import InputOptions, open_clip
    from pdecodec.formats.base.companions import input_files

    # Objects that cannot be read are listed; they are no reason to stop.
    asked = InputOptions(skip_unsupported=True, **reading)
    with standard_input(source) as path, open_clip(path, asked) as sequence:
        say_notices(sequence.notices)
        files = input_files(path)
        facts = {
            **_facts(sequence, all_frames=all_frames),
            "source_bytes": bytes_of(path, files),
            **_connectivity_facts(sequence, len(files)),
            **_content_facts(sequence),
        }
        if all_frames:
            facts["bounds"] = _bounds(sequence)
        questions = _alternatives(sequence, source) if why else ()
        if why:
            from pdecodec.codec.encode.report import to_json

            facts["alternatives"] = to_json(questions)
    if as_json:
        print_json(facts)
    else:
        _print(facts, as_tree=as_tree)
        print_alternatives(questions)


def _alternatives(sequence: MeshSequence, source: str) -> Sequence[Question]:
    """Return the alternatives that the encoder tried, from the file or by encoding it again."""
    from pdecodec.codec.decoder import Animation
    from pdecodec.codec.encode.report import from_json

    if not isinstance(sequence, Animation):
        raise SettingsError("--why needs a .pdeanim file", path=source)
    kept = from_json(sequence.info().get("alternatives"))
    if kept:
        return kept
    from pdecodec.codec.stored_choices import alternatives_of

    say("note: the file keeps no record of alternatives; these are approximate, from encoding it again")
    return alternatives_of(sequence)


def _connectivity_facts(sequence: MeshSequence, files: int) -> dict[str, Any]:
    """Return whether connectivity is constant. If each frame is a file, this reads them all."""
    left_out = [
        {"name": item.name, "feature": item.feature, "first_changed_frame": item.frame} for item in sequence.unsupported
    ]
    changed = next((item.frame for item in sequence.unsupported if item.frame is not None), None)
    if len(sequence.runs) > 1:
        changed = int(sequence.run_starts[1])
    elif files > 1:
        with progress_bar() as progress:
            changed = _first_changed_frame(sequence, progress)
    return {"connectivity_constant": changed is None, "first_changed_frame": changed, "unsupported": left_out}


def _content_facts(sequence: MeshSequence) -> dict[str, Any]:
    """Return how many items of each kind the file holds, and whether they are kept, if its reader lists them."""
    counts = Counter((one.fate, one.kind) for one in sequence.contents)
    found = [{"kind": kind, "count": count, "fate": fate} for (fate, kind), count in counts.items()]
    return {"contents": found} if found else {}


def _first_changed_frame(sequence: MeshSequence, progress: Progress | None) -> int | None:
    try:
        for start, block in sequence.blocks():
            if progress is not None:
                progress(start + len(block), sequence.frame_count, "comparing frames")
    except InputError as error:
        say(f"note: {error}")
        return error.frame
    return None


def _bounds(sequence: MeshSequence) -> list[list[float]]:
    """Return the lowest and highest coordinates of all frames that can be read."""
    import numpy as np

    with progress_bar() as progress:
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for start, block in sequence.blocks():
            finite = block[np.isfinite(block).all(axis=2)]
            if finite.size:
                low, high = np.minimum(low, finite.min(axis=0)), np.maximum(high, finite.max(axis=0))
            if progress is not None:
                progress(start + len(block), sequence.frame_count, "measuring")
    return [low.tolist(), high.tolist()] if np.isfinite(low).all() else []


def _facts(sequence: MeshSequence, *, all_frames: bool) -> dict[str, Any]:
    from pdecodec.codec.decoder import Animation
    from pdecodec.mesh.runs import ChangingSequence

    is_decoded = all_frames or not isinstance(sequence, Animation)
    first = sequence.runs[0]
    objects = first.objects if is_decoded or not isinstance(first, Animation) else first.meshes
    runs: dict[str, Any] = {}
    if isinstance(sequence, ChangingSequence):
        runs["runs"] = len(sequence.runs)
        for name, values in (("run_frames", sequence.run_frames), ("run_vertices", sequence.run_vertices)):
            runs[name] = [int(values.min()), int(values.max())]
    facts: dict[str, Any] = {
        "frames": sequence.frame_count,
        "fps": sequence.fps,
        "first_time": float(sequence.times[0]),
        "last_time": float(sequence.times[-1]),
        "duration": float(sequence.times[-1] - sequence.times[0]),
        "vertices": sequence.most_vertices,
        "faces": sum(item.connectivity.face_count for item in objects),
        "lines": sum(item.connectivity.line_count for item in objects),
        **_cells(objects),
        "raw_bytes": 12 * sequence.position_count,
        **runs,
        **_first_frame(sequence, is_read=is_decoded),
        "fields": first.field_facts(),
        "metadata": dict(sequence.metadata),
        "objects": [_object_facts(item, has_attributes=is_decoded) for item in objects],
    }
    if isinstance(sequence, Animation):
        facts.update(_animation_facts(sequence.info()))
    return facts


def _cells(objects: Sequence[MeshObject]) -> dict[str, dict[str, int]]:
    """Return how many cells of each shape there are; nothing without cells."""
    from pdecodec.mesh.sequence import CELL_SHAPES

    shapes = [CELL_SHAPES[shape] for item in objects for shape in item.connectivity.cell_shapes.tolist()]
    return {"cells": dict(Counter(shapes))} if shapes else {}


def _first_frame(sequence: MeshSequence, *, is_read: bool) -> dict[str, Any]:
    """Return bounds and diagonal of the first frame; None if they are not finite or not read."""
    import numpy as np

    from pdecodec.mesh.metrics import frame_scale

    if not is_read:
        return dict.fromkeys(("finite_at_first_frame", "bounds_at_first_frame", "diagonal"))
    first = sequence.read_frames(0, 1)[0]
    finite = bool(np.isfinite(first).all())
    return {
        "finite_at_first_frame": finite,
        "bounds_at_first_frame": [first.min(axis=0).tolist(), first.max(axis=0).tolist()] if finite else None,
        "diagonal": frame_scale(first) if finite else None,
    }


def _animation_facts(found: dict[str, Any]) -> dict[str, Any]:
    from pdecodec.codec.settings import EncodeSettings

    settings = found["settings"]
    # Another program may have written the settings in another form. This encoder leaves out default settings.
    usual = EncodeSettings().profile
    return {"profile": settings.get("profile", usual) if isinstance(settings, Mapping) else None, **found}


def _object_facts(item: MeshObject, *, has_attributes: bool) -> dict[str, Any]:
    import numpy as np

    corners, counts = np.unique(item.connectivity.face_counts, return_counts=True)
    kinds = {3: "triangles", 4: "quads"}
    by_kind: dict[str, int] = {}
    attributes = [f"{attribute.name} per {attribute.domain}" for attribute in item.attributes]
    for size, count in zip(corners.tolist(), counts.tolist(), strict=True):
        kind = kinds.get(size, "n-gons")
        by_kind[kind] = by_kind.get(kind, 0) + count
    return {
        "name": item.name,
        "vertices": item.vertex_count,
        "faces": by_kind,
        "lines": item.connectivity.line_count,
        "attributes": attributes if has_attributes else None,
    }


def _tree(names: Sequence[str]) -> list[str]:
    """Return a label for each name: its last part, indented under lines for the parts before it.

    A line for a part that is no object ends in a slash.
    """
    lines: list[str] = []
    shown: set[tuple[str, ...]] = set()
    for name in names:
        steps = tuple(name.split("/"))
        for length in range(1, len(steps)):
            if steps[:length] not in shown:
                shown.add(steps[:length])
                lines.append(f"{'  ' * (length - 1)}{steps[length - 1]}/")
        lines.append("  " * (len(steps) - 1) + steps[-1])
    return lines


def _print(facts: Mapping[str, Any], *, as_tree: bool = False) -> None:
    objects = list(map(_object_row, facts["objects"]))
    if as_tree:
        rows = iter(objects)
        names = [item["name"] for item in facts["objects"]]
        objects = [(line, *("",) * 4) if line.endswith("/") else (line, *next(rows)[1:]) for line in _tree(names)]
    print_rows([("object", "vertices", "faces", "lines", "attributes"), *objects])
    constant = "constant" if facts["connectivity_constant"] else f"changes at frame {facts['first_changed_frame']}"
    size = byte_size(facts.get("file_bytes", facts["source_bytes"]))
    table = [
        ("frames", f"{facts['frames']} at {facts['fps']:g} per second"),
        ("time", f"{facts['first_time']:g} to {facts['last_time']:g} s"),
        ("raw positions", byte_size(facts["raw_bytes"])),
        *_bounds_rows(facts),
        ("connectivity", constant),
        *(("left out", f"{item['name']}: {item['feature']}") for item in facts["unsupported"]),
        ("file", f"{size} ({ratio(facts['raw_bytes'], facts['file_bytes'])})" if "file_bytes" in facts else size),
        *([("motion alone", _motion(facts))] if "scene" in facts else []),
        *((name.replace("_", " "), _in_words(facts[name])) for name in facts if name not in _TABLED),
        *_field_rows(facts["fields"]),
        *_scene_rows(facts.get("scene")),
        ("metadata", _in_words(facts["metadata"])),
        *_content_rows(facts),
    ]
    print_rows(table)


def _field_rows(fields: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    """Yield one row per field."""
    for one in fields:
        numbers = f"{one['components']} {one['dtype']}" if one["components"] > 1 else one["dtype"]
        parts = [f"{one['domain']}, {numbers}"]
        if "range" in one:
            low, high = one["range"]
            parts.append(f"{low:.4g} to {high:.4g} {one['unit']}".rstrip())
            parts.append(f"bound {one['bound']:.3g}" if one["bound"] else "exact")
            parts.append(byte_size(one["bytes"]))
            parts += [one["computed"]] if "computed" in one else []
        elif one["unit"]:
            parts.append(one["unit"])
        yield f"field {one['name']}", ", ".join(parts)


def _motion(facts: Mapping[str, Any]) -> str:
    """Return the bytes and the ratio of a file without its fields and scene."""
    alone = round(facts["raw_bytes"] / facts["ratio"])
    return f"{byte_size(alone)} ({ratio(facts['raw_bytes'], alone)})"


def _scene_rows(scene: Mapping[str, Any] | None) -> Iterator[tuple[str, str]]:
    """Yield rows about the scene that a file carries."""
    if scene is None:
        return
    if "error" in scene:
        yield "scene", f"damaged ({scene['error']}); {byte_size(scene['bytes'])}"
        return
    contents = things((one["kind"], one["count"]) for one in scene["contents"])
    yield "scene", f"{scene['format']}, {contents}; {byte_size(scene['bytes'])}"
    for one in scene["streams"]:
        yield f"scene {one['name']}", f"{byte_size(one['size'])} in {byte_size(one['bytes'])}"
    if scene["outside"]:
        yield "not in the scene", ", ".join(scene["outside"])


def _content_rows(facts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield one row per fate (coded, implied, dropped) with the contents of the file that share it."""
    for fate in ("coded", "implied", "dropped"):
        kinds = [f"{one['count']} {one['kind']}" for one in facts.get("contents", ()) if one["fate"] == fate]
        if kinds:
            yield fate, ", ".join(kinds)


def _object_row(item: Mapping[str, Any]) -> tuple[str, ...]:
    faces = ", ".join(counted(count, kind.removesuffix("s")) for kind, count in item["faces"].items()) or "none"
    attributes = "not decoded" if item["attributes"] is None else ", ".join(item["attributes"]) or "none"
    return item["name"], f"{item['vertices']:,}", faces, f"{item['lines']:,}", attributes


def _bounds_rows(facts: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield rows with the bounds of the first frame and of all frames, as far as they are known."""

    def spans(bounds: Sequence[Sequence[float]]) -> str:
        return ", ".join(f"{axis} {low:g} to {high:g}" for axis, low, high in zip("xyz", *bounds, strict=True))

    if facts["finite_at_first_frame"]:
        yield "first frame", f"{spans(facts['bounds_at_first_frame'])}; diagonal {facts['diagonal']:g}"
    elif facts["finite_at_first_frame"] is False:
        yield "first frame", "has positions that are not finite numbers"
    if facts.get("bounds"):
        yield "all frames", spans(facts["bounds"])


_TABLED = (
    "frames", "fps", "first_time", "last_time", "duration", "vertices", "faces", "lines", "raw_bytes", "file_bytes",
    "ratio", "finite_at_first_frame", "bounds_at_first_frame", "diagonal", "metadata", "objects", "source_bytes",
    "connectivity_constant", "first_changed_frame", "unsupported", "bounds", "alternatives", "contents", "fields",
    "scene",
)  # fmt: skip
"""Facts that the table shows in words of its own."""


def _in_words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_in_words(item)}" for name, item in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(_in_words, value)) or "none"
    if value is None or value == "":
        return "none"
    return f"{value:g}" if isinstance(value, float) else str(value)


@click.command()
@json_option
def formats(*, as_json: bool) -> None:
    """List the formats that pdecodec can read and write."""
    from pdecodec.formats import list_formats

    entries = list_formats()
    if as_json:
        names = ("name", "title", "extensions", "reads", "writes", "extra", "keeps", "loses")
        print_json({"formats": [{name: getattr(entry, name) for name in names} for entry in entries]})
        return
    rows = []
    for entry in entries:
        writes = "yes" if entry.writes else entry.write_with or "no"
        rows.append((entry.title, " ".join(entry.extensions), "yes" if entry.reads else "no", writes, entry.keeps))
    print_table(("format", "extensions", "read", "write", "keeps"), rows)
