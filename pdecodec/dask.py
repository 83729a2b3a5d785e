"""The public name of :mod:`pdecodec.batch.dask`: clips in your own Dask graphs (extra ``dask``)."""

from __future__ import annotations

from pdecodec.batch.dask import encode_clips, field, positions

__all__ = ["encode_clips", "field", "positions"]
