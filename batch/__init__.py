"""Encode many clips, one after the other or several at once, and keep a record of each.

Begin with `work.py`: `do_clip` takes one clip from its source to its file and its record. `clips.py` lists the clips of
a manifest, a pattern or a folder. `records.py` tells whether a clip is done, so that an interrupted run resumes where
it stopped. `summary.py` writes the results. `local.py` runs a batch in worker processes on one machine, `cluster.py` on
the workers of a Dask cluster, both within the memory that `memory.py` allows; `dask.py` offers clips to users' own Dask
graphs, as `pdecodec.dask`.
"""

if __name__ != "pdecodec.batch":
    raise ImportError(f"import this package as pdecodec.batch, not as {__name__}")

from pdecodec.batch.clips import Clip, ClipOptions, clips_of
from pdecodec.batch.work import Result, Work, do_clip

__all__ = ["Clip", "ClipOptions", "Result", "Work", "clips_of", "do_clip"]
