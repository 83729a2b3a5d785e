"""Scenes that formats with trees, UVs, groups and curves must restore, and comparisons of scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.attribute_roles import expanded
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject, MeshSequence
from tests.support.browser_tools import assert_valid
from tests.support.mesh_cases import connectivity_of, grid

SPACE = {"up_axis": "Y", "unit": "m"}

IRREGULAR = np.array([0.125, 0.25, 0.3, 0.5, 1.75])

WITH_EXTRA = {"abc": "alembic3d", "usd": "pxr", "usda": "pxr", "usdc": "pxr", "usdz": "pxr"}
"""Extensions whose formats need an extra, with the package that the extra installs."""


def needed(extension: str) -> None:
    """Skip the test if a package that an extension needs is missing; the skip names the package."""
    if extension in WITH_EXTRA:
        pytest.importorskip(WITH_EXTRA[extension], reason=f"what .{extension} needs is not installed here")


def uv_with_seam(name: str = "uv") -> Attribute:
    """Return UVs of a quad and a triangle that share an edge but not the texture coordinates there."""
    values = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.25, 0.5]], np.float32)
    return Attribute(name, "corner", values, np.array([0, 1, 2, 3, 4, 3, 2], np.int32))


def body(name: str = "root/arm/hand", attributes: Sequence[Attribute] | None = None) -> MeshObject:
    """Return an object of five vertices with a quad and a triangle; by default with a UV seam, a group, a
    material and colours.
    """
    default = (
        uv_with_seam(),
        Attribute("group", "face", np.array([1, 0], np.int32), labels=("left", "right")),
        Attribute("material", "face", np.array([0, 1], np.int32), labels=("skin", "nail")),
        Attribute("color", "vertex", np.linspace(0, 1, 15, dtype=np.float32).reshape(5, 3)),
    )
    connectivity = connectivity_of(5, [[0, 1, 2, 3], [2, 1, 4]])
    return MeshObject(name, connectivity, default if attributes is None else tuple(attributes))


def scene(
    objects: Sequence[MeshObject] | None = None,
    times: Float64Array | None = None,
    *,
    frames: int = 5,
    **metadata: str,
) -> ArraySequence:
    """Return objects whose vertices move at random; by default a body, an object without attributes, and two
    polylines.
    """
    curve = MeshObject("root/hair", connectivity_of(5, lines=[[0, 1, 2], [3, 4]]))
    parts = objects or [body(), body("root/arm/nail", ()), curve]
    vertices = sum(item.vertex_count for item in parts)
    points = np.random.default_rng(7).normal(size=(frames, vertices, 3)).astype(np.float32)
    when = np.arange(1, frames + 1) / 24 if times is None else times
    return ArraySequence(points, objects=parts, times=when, fps=24.0, metadata=metadata)


def turning(frames: int, axis: int, speed: float, drift: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return matrices (frames, 4, 4), for points that are rows: rotations about an axis through the origin, and
    a drift.
    """
    angles, found = speed * np.arange(frames), np.repeat(np.eye(4)[None], frames, axis=0)
    first, second = [one for one in range(3) if one != axis]
    found[:, first, first] = found[:, second, second] = np.cos(angles)
    found[:, first, second], found[:, second, first] = np.sin(angles), -np.sin(angles)
    found[:, 3, :3] = drift * np.arange(frames)[:, None]
    return found


TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)

OUTWARD = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
"""Faces of a tetrahedron, counterclockwise seen from outside."""


def volume(sequence: MeshSequence, frame: int = 0) -> float:
    """Return the volume that triangles enclose at a frame; negative if they are inside out."""
    corners = sequence.connectivity.face_indices.reshape(-1, 3)
    return float(np.linalg.det(sequence.read_frames(frame, frame + 1)[0][corners].astype(np.float64)).sum() / 6)


def machine(frames: int = 30, parts: int = 4, size: int = 6) -> ArraySequence:
    """Return objects that rotate, drift, stand still and bend, in this order again and again; the first is a
    root, the others are parts of one tree.
    """
    rng, points, objects = np.random.default_rng(3), [], []
    for part in range(parts):
        shape = rng.normal(size=(size * size, 3)) + 3 * part
        kind = part % 4
        moves = turning(frames, part % 3, 0.4 if kind == 0 else 0.0, rng.normal(size=3) * (0.1 if kind < 2 else 0))
        moved = shape @ moves[:, :3, :3] + moves[:, 3:, :3]
        if kind == 3:
            moved = moved * (1 + 0.01 * np.sin(np.arange(frames))[:, None, None])
        points.append(moved)
        objects.append(MeshObject("alone" if part == 0 else f"rig/part{part}", grid(size, size)))
    return ArraySequence(np.concatenate(points, axis=1), objects=objects, fps=24, metadata=SPACE)


def assert_lawful(path: str | Path) -> None:
    """Check a file with USD's checker or Khronos' validator of glTF; call this last, because it may skip the test."""
    if ".usd" in str(path):
        assert broken_rules(Path(path)) == []
    if ".gl" in str(path):
        assert_valid(Path(path))


def broken_rules(path: Path) -> list[str]:
    """Return the complaints of usdchecker about a file; none if only the axis or the unit is unknown."""
    from pxr import Usd, UsdUtils

    if hasattr(UsdUtils, "ComplianceChecker"):
        checker = UsdUtils.ComplianceChecker(arkit=False)
        checker.CheckCompliance(str(path))
        said = [*checker.GetErrors(), *checker.GetFailedChecks(), *checker.GetWarnings()]
        return [line for line in said if "upAxis" not in line and "metersPerUnit" not in line]
    from pxr import UsdValidation

    # From 26 on usdchecker runs the validators of every library instead.
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    unknown = ("MissingUpAxisMetadata", "MissingMetersPerUnitMetadata")
    return [f"{error.GetName()}: {error.GetMessage()}" for error in found if error.GetName() not in unknown]


def written(clip: MeshSequence, path: Path, **options: str) -> MeshSequence:
    """Write a sequence, and open it again."""
    write_sequence(clip, path)
    # The options are those of any reader, whose types mypy cannot tell.
    return open_sequence(path, **options)  # type: ignore[arg-type]


def assert_same_scene(
    read: MeshSequence, written: MeshSequence, *, attributes: bool = True, error: float = 0.0
) -> None:
    """Assert that two scenes are equal: positions to the bit or to a relative error, times to a nanosecond,
    names, faces, lines, attributes.
    """
    assert [item.name for item in read.objects] == [item.name for item in written.objects]
    expected = written.read_frames(0, written.frame_count)
    assert np.abs(read.read_frames(0, read.frame_count) - expected).max() <= error * np.abs(expected).max()
    assert np.allclose(read.times, written.times, rtol=0, atol=1e-9)
    assert read.fps == pytest.approx(written.fps, rel=1e-9)
    for mine, other in zip(read.objects, written.objects, strict=True):
        assert_same_connectivity(mine.connectivity, other.connectivity)
        if attributes:
            assert sorted(one.name for one in mine.attributes) == sorted(one.name for one in other.attributes)
            assert_has_attributes(mine, other.attributes)


def assert_same_connectivity(mine: Connectivity, other: Connectivity) -> None:
    assert mine.vertex_count == other.vertex_count
    for name in ("face_counts", "face_indices", "line_counts", "line_indices"):
        assert getattr(mine, name).tolist() == getattr(other, name).tolist(), name


def assert_has_attributes(mine: MeshObject, attributes: Sequence[Attribute], *, error: float = 0) -> None:
    """Compare attributes by name, in any order."""
    found = {one.name: one for one in mine.attributes}
    for expected in attributes:
        one = found[expected.name]
        assert (one.domain, one.labels) == (expected.domain, expected.labels)
        assert np.allclose(one.values, expected.values, rtol=0, atol=error), one.name
        assert (one.indices is None) == (expected.indices is None), one.name
        if one.indices is not None and expected.indices is not None:
            assert one.indices.tolist() == expected.indices.tolist()


def meaning_of(attribute: Attribute) -> NDArray[Any]:
    """Return the value of each element of an attribute; labels as text, integer colours divided by 255."""
    values = expanded(attribute)
    if attribute.labels:
        return np.array([attribute.labels[row] if row >= 0 else "" for row in values])
    return values / np.float32(255) if attribute.name.startswith("color") and values.dtype.kind == "u" else values


def array_of(data: Path, name: str) -> dict[str, NDArray[np.generic]]:
    """Return a sequence of the shared data as named arrays."""
    with np.load(data / "sequences" / f"{name}.npz") as archive:
        return dict(archive)
