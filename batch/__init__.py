"""Many clips: which they are, one after the other or side by side, and what became of each.

What is done stands in a record of each clip, beside the outputs: a run that was cut off goes on where it was, and any
number of runs, of one machine or of many, may share the work.
"""

if __name__ != "pdecodec.batch":
    raise ImportError(f"import this package as pdecodec.batch, not as {__name__}")

from pdecodec.batch.clips import Clip, ClipOptions, clips_of
from pdecodec.batch.work import Result, Work, do_clip

__all__ = ["Clip", "ClipOptions", "Result", "Work", "clips_of", "do_clip"]
