"""Spatial bases to choose from: patches, or pieces of curves, of several sizes on one reference frame."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor, Future

from pdecodec.codec.sections.elements import EarlyPatches
from pdecodec.codec.sections.reference import ReferenceFrame
from pdecodec.codec.sections.space_basis import SpaceBasis, SpaceKind, trial_space_basis
from pdecodec.mesh.sequence import MeshObject


class SpatialBases:
    """Cache of spatial bases on one reference frame, each made once, ahead in another thread or when asked for.

    Parameters
    ----------
    objects : sequence of MeshObject
    reference : ReferenceFrame
    functions : int
        Largest number of functions of an element.
    patches : EarlyPatches
    ahead : ThreadPoolExecutor
        Makes bases ahead.
    """

    def __init__(
        self,
        objects: Sequence[MeshObject],
        reference: ReferenceFrame,
        functions: int,
        patches: EarlyPatches,
        ahead: Executor,
    ) -> None:
        self._objects, self._reference, self._functions, self._patches = objects, reference, functions, patches
        self._ahead = ahead
        self._begun: dict[tuple[SpaceKind, int], Future[SpaceBasis]] = {}

    def begin(self, spaces: Sequence[tuple[SpaceKind, int]]) -> None:
        """Start making bases in the other thread."""
        for space in spaces:
            if space not in self._begun:
                self._begun[space] = self._ahead.submit(self._build, space)

    def basis(self, space: tuple[SpaceKind, int]) -> SpaceBasis:
        """Return the basis of a kind and size."""
        return self._begun[space].result() if space in self._begun else self._build(space)

    def _build(self, space: tuple[SpaceKind, int]) -> SpaceBasis:
        kind, points = space
        return trial_space_basis(
            kind,
            self._objects,
            self._reference.grid,
            points=points,
            functions=self._functions,
            early=self._patches,
            ties=self._reference.ties,
        )
