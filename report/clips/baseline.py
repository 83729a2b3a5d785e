"""Interface of a coder to compare with: an encoder with one length to adjust, and a decoder.

`pdecodec.research.baselines` implements it; callers of :func:`pdecodec.report.clips.making.make_report` may pass
others.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import importlib.util
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import ClassVar, Generic, TypeVar

import numpy as np

from pdecodec import _core
from pdecodec.errors import MissingExtraError
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity

Quantised = TypeVar("Quantised")

Encoder = Callable[[float], bytes]
"""A function from a length [scene units] to bytes; a larger length gives fewer bytes and a larger error."""

MAX_BITS = 52
"""Largest number of bits of a rounded number; more are finer than float64."""


class UnreachableError(ValueError):
    """The baseline cannot be as exact as required; the message says why. This is a result, not a failed run."""


class Baseline(ABC):
    """One way to store positions.

    Attributes
    ----------
    name : str
        A few words, for tables.
    source : str
        Where it is described.
    package : str or None
        Python package that it needs, of the extra `baselines`; None if pdecodec's own dependencies suffice.
    published : bool
        Whether it is its source's scheme, coded as well as we can; False if a stage is added that the source lacks.
    codes_fields : bool
        Whether it also takes (frames, rows, 1) values of a field, with an absolute error as the length.
    adjustable : bool
        Whether the length given to the encoder matters; otherwise there is one size and one error.
    """

    name: str
    source: str
    package: ClassVar[str | None] = None
    published: ClassVar[bool] = True
    codes_fields: ClassVar[bool] = False
    adjustable: ClassVar[bool] = True

    @abstractmethod
    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        """Return the encoder of one sequence, with all work done that does not depend on the length.

        Parameters
        ----------
        points : (frames, vertices, 3) float32 [scene units]
        connectivity : Connectivity
            The decoder has it as well, so it is not in the bytes.

        Returns
        -------
        callable
            ``encode(length) -> bytes``; raises :class:`UnreachableError` below the smallest length it supports.
        """

    @abstractmethod
    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        """Decode positions, (frames, vertices, 3) float32 [scene units], from the bytes of its own encoder."""

    def effective_length(self, length: float) -> float:
        """Return the length that represents all lengths with the same bytes as `length`; by default all differ."""
        return length

    def missing(self) -> str | None:
        """Return why it cannot run here and what to do about it; None if it can."""
        if self.package is None or importlib.util.find_spec(self.package) is not None:
            return None
        return f"{self.name} needs the package {self.package}: pip install 'pdecodec[baselines]'"

    def require(self) -> None:
        """Raise MissingExtraError if :meth:`missing` returns a reason."""
        reason = self.missing()
        if reason is not None:
            raise MissingExtraError(reason)

    def version(self) -> str:
        """Return a digest that changes when results may: of the name, the code and the package's version."""
        folder = Path(str(sys.modules[type(self).__module__].__file__)).parent
        digest = hashlib.sha256(self.name.encode() + code_digest(folder))
        if self.package is not None:
            digest.update(importlib.metadata.version(self.package).encode())
        return digest.hexdigest()[:16]


@cache
def code_digest(folder: Path) -> bytes:
    """Return a digest of a folder's modules, of the rate search, and of the range coder's bytes of some values.

    Comments, docstrings and layout do not count.
    """
    digest = hashlib.sha256(_core.encode_bands(np.arange(-999, 1000).reshape(1, -1)))
    for path in [*sorted(folder.glob("*.py")), Path(__file__).with_name("ratesearch.py"), Path(__file__)]:
        digest.update(ast.dump(_WithoutTexts().visit(ast.parse(path.read_text(encoding="utf-8")))).encode())
    return digest.digest()


class _WithoutTexts(ast.NodeTransformer):
    """Removes docstrings and the texts under constants."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node


class Transform(Baseline, Generic[Quantised]):
    """A baseline that rounds numbers of its own, so that its loss is known before anything is coded.

    Analysis, rounding, coding and synthesis are separate: a search for a length need not code at every step.
    """

    @abstractmethod
    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], Quantised]:
        """Return a function that rounds one sequence, ``round_to(length) -> quantised``; parameters as
        :meth:`prepare`.
        """

    @abstractmethod
    def write(self, quantised: Quantised, connectivity: Connectivity) -> bytes:
        """Return everything that :meth:`read` needs to restore the rounded numbers."""

    @abstractmethod
    def read(self, data: bytes, connectivity: Connectivity) -> Quantised:
        """Undo :meth:`write`."""

    @abstractmethod
    def synthesise(self, quantised: Quantised, connectivity: Connectivity) -> Float32Array:
        """Return positions from the rounded numbers, (frames, vertices, 3) float32 [scene units]."""

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        round_to = self.analyse(points, connectivity)
        return lambda length: self.write(round_to(length), connectivity)

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        return self.synthesise(self.read(data, connectivity), connectivity)


def rounded(values: Float64Array, step: float) -> Int64Array:
    """Return the nearest multiples of a step, in steps.

    Raises
    ------
    UnreachableError
        If one would have more than :data:`MAX_BITS` bits.
    """
    largest = float(np.abs(values).max(initial=0.0))
    if largest >= 2.0**MAX_BITS * step:
        raise UnreachableError(f"steps of {step:.3g} for numbers up to {largest:.3g} are more than {MAX_BITS} bits")
    return np.rint(values / step).astype(np.int64)
