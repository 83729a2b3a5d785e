"""What a peer is: an encoder with one length to turn, and a decoder."""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
import importlib.util
import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np

from pdecodec.errors import MissingExtraError
from pdecodec.sequence import Connectivity, Float32Array

Encoder = Callable[[float], bytes]
"""From a length [scene units] to bytes: the larger the length, the fewer bytes and the larger the error."""


class UnreachableError(ValueError):
    """A peer cannot be as exact as was asked; the message says why. Not a failure of a run: a result."""


class Peer(ABC):
    """One way to keep positions.

    Attributes
    ----------
    name : str
        In a few words, for tables.
    source : str
        Where it is described.
    package : str or None
        Python package that it needs, of the extra `peers`; None: nothing beyond pdecodec's own.
    published : bool
        Whether it is its source's scheme, coded as well as we can; False where a stage is added that the source
        does not have.
    adjustable : bool
        Whether the length given to the encoder matters: if not, there is one size and one error.
    """

    name: str
    source: str
    package: ClassVar[str | None] = None
    published: ClassVar[bool] = True
    adjustable: ClassVar[bool] = True

    @abstractmethod
    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        """The encoder of one sequence, with all that does not depend on the length done.

        Parameters
        ----------
        points : (frames, vertices, 3) float32 [scene units]
        connectivity : Connectivity
            Known to the decoder as well, so it is not in the bytes.

        Returns
        -------
        callable
            ``encode(length) -> bytes``; raises :class:`UnreachableError` below the least length it can do.
        """

    @abstractmethod
    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        """Positions from the bytes of this peer's own encoder.

        Returns
        -------
        (frames, vertices, 3) float32 [scene units]
        """

    def effective_length(self, length: float) -> float:
        """The one length that stands for all that give the same bytes as `length`; by default all differ."""
        return length

    def missing(self) -> str | None:
        """Why it cannot run here, with what to do about it; None where it can."""
        if self.package is None or importlib.util.find_spec(self.package) is not None:
            return None
        return f"{self.name} needs the package {self.package}: pip install 'pdecodec[peers]'"

    def require(self) -> None:
        """Raise MissingExtraError where :meth:`missing` has something to say."""
        reason = self.missing()
        if reason is not None:
            raise MissingExtraError(reason)

    def version(self) -> str:
        """Changes when its results may: a digest of its name, its code, the code it shares, and its package."""
        digest = hashlib.sha256(self.name.encode() + _coded_probe())
        for path in sorted({Path(inspect.getfile(type(self))), *_shared_files()}):
            digest.update(_code_of(path).encode())
        if self.package is not None:
            digest.update(importlib.metadata.version(self.package).encode())
        return digest.hexdigest()[:16]


def _shared_files() -> list[Path]:
    """The modules that several peers are made of."""
    here = Path(__file__).parent
    shared = ("grid", "planes", "prediction", "principal", "search", "shuffle", "symbols", "transform", "traversal")
    return [here / f"{name}.py" for name in shared]


@cache
def _coded_probe() -> bytes:
    """What the range coder, which is the codec's and not the peers', makes of some integers."""
    from pdecodec.peers.symbols import encode_bands

    return encode_bands(np.arange(-999, 1000).reshape(1, -1))


class _WithoutTexts(ast.NodeTransformer):
    """Takes out docstrings and the texts under constants."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node


def _code_of(path: Path) -> str:
    """What a module does, whatever its comments, docstrings and layout."""
    return ast.dump(_WithoutTexts().visit(ast.parse(path.read_text(encoding="utf-8"))))
