"""Decide what moves a mesh of a simulation, by one rule for VTK, XDMF and Exodus; list the data that are not kept.

1. Geometry that the file stores for every step is used as it is.
2. Vectors on nodes are added to it if the format itself defines them as displacements. Only Exodus does: by the
   convention of its own programs, nodal variables of every axis whose name begins with ``disp``.
3. Or if the user names them, ``displacement="u"``; ``displacement="none"`` adds none.
4. Other vectors (``u``, velocities) move nothing: if the mesh stands still, a notice lists them as candidates.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, Notice, damaged
from pdecodec.formats.base.frame_changes import kept_of, not_kept
from pdecodec.mesh.sequence import Content, Fate, MeshObject

NO_DISPLACEMENT = "none"
"""Value of the option ``displacement`` that adds no vectors."""

NEVER_DISPLACEMENTS = ("normals", "color")
"""Vectors, in lower case, that are not suggested as displacements: our own writers store them next to the mesh."""


def choose_vectors(vectors: Sequence[str], asked: str | None, path: Path, *, defined: Sequence[str] = ()) -> str | None:
    """Return the name of the vectors that are added to the geometry, None for none.

    Parameters
    ----------
    vectors : sequence of str
        Names of vectors on nodes.
    asked : str or None
        The option ``displacement``.
    path : pathlib.Path
        The file, for errors.
    defined : sequence of str
        Those of `vectors` that the format defines as displacements.

    Raises
    ------
    InputError
        If no vectors have the name `asked`, or the format defines several displacements.
    """
    if asked is None:
        if len(defined) > 1:
            raise InputError(
                f"several vectors are displacements ({quoted(defined)})",
                code="ambiguous-input",
                path=path,
                setting="displacement",
                purpose=f"to one of them, or to {NO_DISPLACEMENT}",
            )
        return defined[0] if defined else None
    if asked in vectors:
        return asked
    if asked.lower() == NO_DISPLACEMENT:
        return None
    alike = [name for name in vectors if name.lower() == asked.lower()]
    if len(alike) == 1:
        return alike[0]
    there = f"there are {quoted(vectors)}" if vectors else "there are no vectors on nodes"
    message = f"has no vectors {asked!r} on its nodes that could be its displacement; {there}"
    raise InputError(message, code="object-missing", path=path)


def motion_notices(chosen: str | None, vectors: Sequence[str], asked: str | None, *, moves: bool) -> tuple[str, ...]:
    """Return a notice that says which vectors move the mesh, or which could if its geometry stands still."""
    if chosen is not None:
        return (f"the vectors {chosen!r} are added to the geometry: they move the mesh",)
    vectors = [name for name in vectors if name.lower() not in NEVER_DISPLACEMENTS]
    if moves or asked is not None or not vectors:
        return ()
    text = f"the mesh does not move: nothing marks {quoted(vectors)} as its displacement"
    return (Notice(text, setting="displacement", value="NAME", purpose="to add vectors to the geometry"),)


def not_kept_data(names: Mapping[str, Iterable[str]]) -> tuple[str, ...]:
    """Return a notice that lists data that are not kept, by kind: ``{"point data": ["temperature"]}``."""
    listed = [f"{kind} {quoted(found)}" for kind, one in names.items() if (found := list(dict.fromkeys(one)))]
    if not listed:
        return ()
    head = ", ".join(listed[:-1])
    return not_kept([f"{head} and {listed[-1]}" if head else listed[0]], "{} are not kept")


def contents_of(
    objects: Iterable[MeshObject], kept: Mapping[str, Iterable[str]], lost: Mapping[str, Iterable[str]]
) -> tuple[Content, ...]:
    """List what files hold: objects, and data by kind that are kept, or lost (as :func:`not_kept_data` says)."""
    fates: tuple[tuple[Fate, Mapping[str, Iterable[str]]], ...] = (("coded", kept), ("dropped", lost))
    return (
        *(one for item in objects for one in kept_of(item)),
        *(
            Content(f"/{kind}/{name}", kind, fate)
            for fate, data in fates
            for kind, names in data.items()
            for name in dict.fromkeys(names)
        ),
    )


def quoted(names: Iterable[str]) -> str:
    """Return names as they appear in messages: ``'a', 'b'``."""
    return ", ".join(map(repr, names))


def moved(points: NDArray[np.floating], vectors: NDArray[np.generic], name: str, path: Path) -> NDArray[np.floating]:
    """Return points (nodes, 3) with the vectors (nodes, 1 to 3) of this name added.

    Raises
    ------
    InputError
        If the numbers of vectors and points differ, or vectors have another number of components.
    """
    if vectors.ndim != 2 or len(vectors) != len(points) or not 1 <= vectors.shape[1] <= 3:
        raise damaged(
            f"the displacement {name!r} has shape {vectors.shape}, and there are {len(points)} nodes; export it again",
            path=path,
        )
    found = points.astype(np.result_type(points, vectors, np.float32), copy=True)
    found[:, : vectors.shape[1]] += vectors
    return found
