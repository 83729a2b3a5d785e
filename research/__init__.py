"""Measure what the README and the docs claim: install with the extra `research`.

* ``reproduction/``: section 5 of the paper repeated and judged claim by claim; begin with ``reproduction/report.py``.
* ``stability/``: where each method breaks, compared with its alternatives; begin with ``stability/atlas.py``.
* ``baselines/``: other coders to compare with; each implements `pdecodec.report.clips.baseline.Baseline`.
* ``bench.py``: speed and memory compared with other tools: ``make bench``.
* ``growth.py``: time and memory over frames and vertices: ``make growth``.

Nothing that encodes or decodes depends on this package. It takes charts and pages from `pdecodec.report`.
"""
