"""Meshes that move: what goes into the codec and what comes out of it.

Begin with ``sequence.py``: `MeshSequence` gives blocks of frames of float32 positions over constant `Connectivity`,
with names, times and attributes; `ArraySequence` is one in memory. ``runs.py`` puts sequences of different connectivity
on one timeline. ``selection.py`` takes some frames or objects. ``metrics.py`` and ``surface_metrics.py`` measure how
far two sequences are apart. ``times.py`` makes times at a rate and brings times into a clip. ``rounding.py`` notes how
far float64 positions move when they become float32. ``arrays.py`` names the types of arrays.
"""
