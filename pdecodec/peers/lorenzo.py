"""Quantise, differences in time, parallelograms across the mesh, range coder: prediction without a transform."""

from __future__ import annotations

import numpy as np

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.grid import Grid
from pdecodec.peers.peer import Encoder, Peer
from pdecodec.peers.prediction import decode_over_mesh, encode_over_mesh
from pdecodec.peers.traversal import traverse
from pdecodec.sequence import Connectivity, Float32Array

ORDERS = (1, 2)
"""Of the differences in time: the second wins where motion is smooth and the bound tight."""


class Lorenzo(Peer):
    """Dynapack's extended Lorenzo predictor, with the mean of several parallelograms."""

    name = "extended Lorenzo (Dynapack)"
    source = "Ibarria and Rossignac 2003, Dynapack: space-time compression of the 3D animations of triangle meshes"

    def prepare(self, points: Float32Array, connectivity: Connectivity) -> Encoder:
        traversal = traverse(connectivity)

        def encode(length: float) -> bytes:
            grid = Grid.within(points, length)
            differences = grid.levels(points)
            coded = []
            for _ in ORDERS:
                differences = np.diff(differences, axis=0, prepend=0)
                columns = differences.transpose(1, 0, 2).reshape(points.shape[1], -1)
                coded.append(encode_over_mesh(columns, traversal))
            order, smallest = min(zip(ORDERS, coded, strict=True), key=lambda each: len(each[1]))
            writer = FieldWriter()
            grid.write(writer)
            writer.numbers("QB", points.shape[0], order)
            writer.sized(smallest)
            return writer.to_bytes()

        return encode

    def decode(self, data: bytes, connectivity: Connectivity) -> Float32Array:
        reader = FieldReader(data, self.name)
        grid = Grid.read(reader)
        frames, order = reader.integers("QB")
        columns = decode_over_mesh(reader.sized(), 3 * frames, traverse(connectivity))
        levels = columns.reshape(-1, frames, 3).transpose(1, 0, 2)
        for _ in range(order):
            levels = np.cumsum(levels, axis=0)
        return grid.positions(levels)
