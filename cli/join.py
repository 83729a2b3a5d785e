"""`pdecodec join`: see :mod:`pdecodec.cli.cut`."""

from __future__ import annotations

from pdecodec.cli.cut import join as join
