"""What other programs show of files: Blender, three.js and OpenUSD. Each opens many files in one start."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.three_player import play

HERE = Path(__file__).resolve().parent

PATIENCE = 3600
"""Time limit of a program for all its files [s]."""

BLENDER = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
"""Converts rows of coordinates from a Y-up file to Blender, which is Z-up."""


@dataclass(frozen=True)
class Job:
    """A file and the times [s] at which a program shows it; `fps` is its nominal rate."""

    path: Path
    times: tuple[float, ...]
    fps: float


@dataclass(frozen=True, eq=False)
class Seen:
    """The meshes of a file as a program shows them, Y-up.

    Attributes
    ----------
    points : (times, points, 3) float64
    failed : str
        The program's message if it failed; otherwise empty.
    normals, corners : (times, corners, 3), (corners,) or None
        None if the program does not report them.
    materials : int
    uvs : int
        Largest number of UV sets of a mesh.
    """

    points: np.ndarray[Any, Any]
    failed: str = ""
    normals: np.ndarray[Any, Any] | None = None
    corners: np.ndarray[Any, Any] | None = None
    materials: int = 0
    uvs: int = 0


def failure(reason: str) -> Seen:
    """Return the result for a program that did not show a file."""
    return Seen(np.zeros((0, 0, 3)), failed=reason)


def blender_shows(jobs: Sequence[Job], folder: Path) -> list[Seen] | str:
    """Return what Blender shows, or the reason if it is missing."""
    python = os.environ.get("PDECODEC_BLENDER")
    if not python:
        return "Blender is not here; set PDECODEC_BLENDER to a Python that has the package bpy"
    listed = [
        {
            "path": str(job.path),
            "out": str(folder / f"blender{number}.npz"),
            "fps": job.fps,
            "frames": [time * job.fps for time in job.times],
        }
        for number, job in enumerate(jobs)
    ]
    (folder / "jobs.json").write_text(json.dumps(listed), encoding="utf-8")
    for job in listed:
        # Remove outputs of another format's jobs, which have the same names.
        Path(str(job["out"])).unlink(missing_ok=True)
    command = [python, str(HERE / "blender_job.py"), str(folder / "jobs.json")]
    subprocess.run(command, capture_output=True, check=False, timeout=PATIENCE)
    found = []
    for job in listed:
        if not Path(str(job["out"])).exists():
            found.append(failure("Blender ended"))
            continue
        with np.load(str(job["out"])) as arrays:
            if "failed" in arrays:
                found.append(failure(str(arrays["failed"])))
                continue
            found.append(
                Seen(
                    arrays["points"] @ BLENDER.T,
                    normals=arrays["normals"] @ BLENDER.T,
                    corners=arrays["corners"],
                    materials=arrays["materials"].size,
                    uvs=int(arrays["uvs"]),
                )
            )
    return found


def three_shows(jobs: Sequence[Job], folder: Path) -> list[Seen] | str:
    """Return what three.js shows of glTF files, or the reason if it is missing."""
    try:
        played = play([(job.path, job.times) for job in jobs], folder / "profile", draw=False)
    except pytest.skip.Exception as reason:
        return str(reason)
    found = []
    for job, meshes in zip(jobs, played, strict=True):
        if isinstance(meshes, str):
            found.append(failure(meshes))
            continue
        shown = [mesh.points for mesh in meshes if mesh.kind.endswith("Mesh")]
        points = np.concatenate([np.zeros((len(job.times), 0, 3)), *shown], axis=1)
        found.append(Seen(points))
    return found


def openusd_shows(jobs: Sequence[Job]) -> list[Seen] | str:
    """Return what OpenUSD itself reads of the meshes of its files."""
    try:
        from pxr import Usd, UsdGeom, UsdShade
    except ModuleNotFoundError:
        return "OpenUSD is not here; pip install usd-core"
    found = []
    for job in jobs:
        stage = Usd.Stage.Open(str(job.path))
        meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
        rows, rate = [], stage.GetTimeCodesPerSecond()
        for time in job.times:
            cache = UsdGeom.XformCache(Usd.TimeCode(time * rate))
            here = [np.zeros((0, 3))]
            for mesh in meshes:
                place = np.array(cache.GetLocalToWorldTransform(mesh.GetPrim()))
                points = np.array(mesh.GetPointsAttr().Get(time * rate), np.float64).reshape(-1, 3)
                here.append(points @ place[:3, :3] + place[3, :3])
            rows.append(np.concatenate(here))
        subsets = [one for mesh in meshes for one in UsdShade.MaterialBindingAPI(mesh).GetMaterialBindSubsets()]
        sets = [
            sum(str(one.GetTypeName().role) == "TextureCoordinate" for one in UsdGeom.PrimvarsAPI(mesh).GetPrimvars())
            for mesh in meshes
        ]
        names = {str(one.GetPrim().GetName()) for one in subsets}
        found.append(Seen(np.stack(rows), materials=len(names), uvs=max(sets, default=0)))
    return found
