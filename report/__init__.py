"""Measurements: what the codec, the paper and the baselines do on given sequences, and pages about it.

matplotlib and vl-convert, of the extra `report`, draw; they load where something is drawn.
"""

if __name__ != "pdecodec.report":
    raise ImportError(f"import this package as pdecodec.report, not as {__name__}")
