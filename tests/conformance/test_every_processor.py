"""The same bytes on every processor, whatever kernels numpy, its BLAS, the C library or the core choose for it."""

from __future__ import annotations

import ast
import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import encode
from pdecodec.codec.opening import open_animation
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from pdecodec.simulate import build
from tests.support.mesh_cases import grid

PROCESSORS: dict[str, dict[str, str]] = {
    "this one": {},
    "AVX-512": {"OPENBLAS_CORETYPE": "SkylakeX", "PDECODEC_INSTRUCTIONS": "avx512f"},
    "AVX2": {
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F",
        "PDECODEC_INSTRUCTIONS": "avx2",
    },
    "SSE": {
        "OPENBLAS_CORETYPE": "Sandybridge",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA",
        "PDECODEC_INSTRUCTIONS": "usual",
        "PDECODEC_THREADS": "1",
    },
}
"""Environment variables that make libraries choose code for another processor, as far as this one supports it."""

ENCODES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("waves", {"profile": "paper"}),
    ("large waves", {"profile": "paper"}),
    ("poses", {"tolerance": 1e-3}),
    ("noise", {"tolerance": 1e-3}),
    ("modes", {"tolerance": 2e-4}),
    ("modes", {"tolerance": 2e-4, "effort": "fast"}),
    ("large modes", {"tolerance": 1e-3}),
    ("large modes", {"tolerance": 2e-4, "effort": "fast"}),
)
"""Clips and settings. The clips have many coefficients, so that different last bits would change some of them."""

SCENES = ("cloth",)
"""Scenes of the simulator that do not use the C library's sine, whose last bits depend on the processor."""

SCRIPT = """
from tests.conformance.test_every_processor import print_digests
print_digests()
"""


def sheet(rows: int, heights: Float64Array) -> ArraySequence:
    """Return a sheet of `rows` x `rows` vertices with heights (frames, rows, rows)."""
    x, y = np.meshgrid(np.arange(rows), np.arange(rows))
    points = np.stack([*np.broadcast_arrays(x, y, heights)], axis=-1).reshape(len(heights), -1, 3)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, rows))])


def waves(rows: int, frames: int) -> ArraySequence:
    """Return waves that run over a sheet, which need few functions of time."""
    x, y = np.meshgrid(np.arange(rows), np.arange(rows))
    at = np.arange(frames)[:, None, None]
    return sheet(rows, 0.002 * x * x * np.sin(0.3 * x + 0.4 * at) + 0.5 * np.cos(0.2 * y - 0.3 * at))


def modes(rows: int, frames: int, count: int) -> ArraySequence:
    """Return a clip of several shapes that swing at different frequencies."""
    random, at = np.random.default_rng(1), np.arange(frames)
    shapes = random.normal(size=(count, rows, rows))
    for _ in range(2):
        shapes = (shapes + np.roll(shapes, 1, 1) + np.roll(shapes, 1, 2)) / 3.0
    paces, phases = random.uniform(0.02, 1.0, count), random.uniform(0.0, 6.0, count)
    swings = np.cos(np.outer(at, paces) + phases) / np.arange(1, count + 1)
    return sheet(rows, np.einsum("tk,kxy->txy", swings, shapes))


def noise() -> ArraySequence:
    """Return motion that needs the largest number of functions of time."""
    return sheet(12, np.cumsum(np.random.default_rng(6).normal(size=(90, 12, 12)), axis=0))


def poses() -> ArraySequence:
    """Return frames between a few poses, as of a character's face."""
    random = np.random.default_rng(9)
    keys = random.normal(size=(7, 16, 16)) * (random.random((7, 16, 16)) < 0.2)
    shares = np.maximum(0.0, 1.0 - np.abs(np.linspace(0, 6, 60)[:, None] - np.arange(7)))
    return sheet(16, (shares[:, :, None, None] * keys).sum(axis=1))


CLIPS: dict[str, Callable[[], ArraySequence]] = {
    "waves": lambda: waves(20, 40),
    "large waves": lambda: waves(48, 50),
    "poses": poses,
    "noise": noise,
    "modes": lambda: modes(40, 100, 80),
    "large modes": lambda: modes(50, 150, 60),
}


def print_digests() -> None:
    """Print a line with digests: of the bytes of each encode, the positions of each decode, and each simulation."""

    def print_digest(*words: object, data: bytes) -> None:
        print(*words, hashlib.sha256(data).hexdigest())

    for name, options in ENCODES:
        data = encode(CLIPS[name](), **options).data
        assert data is not None
        print_digest("encode", name, options, data=data)
        with open_animation(data) as animation:
            print_digest("decode", name, options, data=animation.positions(animation.times).tobytes())
    for name in SCENES:
        clip = build(name).simulate(frames=6)
        print_digest("simulate", name, data=clip.read_frames(0, 6).tobytes())


def digests_on(processor: str) -> str:
    """Return what `print_digests` prints in a separate process."""
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, **PROCESSORS[processor], "PYTHONPATH": str(root)}
    command = [sys.executable, "-c", SCRIPT]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True, cwd=root).stdout


@pytest.fixture(scope="module")
def digests() -> dict[str, str]:
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(PROCESSORS, pool.map(digests_on, PROCESSORS), strict=True))


@pytest.mark.parametrize("processor", [name for name in PROCESSORS if name != "this one"])
def test_every_processor_encodes_decodes_and_simulates_alike(processor: str, digests: dict[str, str]) -> None:
    assert digests["this one"].count("\n") == 2 * len(ENCODES) + len(SCENES)
    assert digests[processor] == digests["this one"]


OTHER_BITS = {"linalg", "einsum", "tensordot", "matmul", "dot", "vdot", "inner"} | {
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "power", "hypot", "cbrt"),
    *("sin", "cos", "tan", "sinh", "cosh", "tanh", "arcsin", "arccos", "arctan", "arctan2"),
}
"""Names of numpy's functions whose last bits differ from processor to processor."""

OF_THE_PAPER = {"closed_form.py"}
"""Modules with the paper's functions as printed, which no encode uses."""


def test_the_encoder_calls_nothing_of_numpy_that_depends_on_the_processor() -> None:
    codec = Path(__file__).resolve().parents[2] / "pdecodec" / "codec"
    found = []
    paths = sorted([*(codec / "encode").glob("*.py"), *(codec / "sections").glob("*.py")])
    assert len(paths) > 20
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            is_product = isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult)
            is_numpys = isinstance(node, ast.Attribute) and ast.unparse(node.value) == "np" and node.attr in OTHER_BITS
            if (is_product or is_numpys) and path.name not in OF_THE_PAPER:
                found.append(f"{path.name}: {ast.unparse(node)}")
    assert not found
