"""Mesh sequences: the input of the codec and its output.

Begin with ``sequence.py``: `MeshSequence` returns blocks of frames of float32 positions over constant
`Connectivity`, with names, times and attributes; `ArraySequence` is one in memory. ``runs.py`` puts sequences of
different connectivity on one timeline. ``selection.py`` selects frames or objects. ``metrics.py`` and
``surface_metrics.py`` measure the distance between two sequences. ``times.py`` makes times at a rate, and handles
times outside a clip. ``rounding.py`` records how far float64 positions move when they become float32. ``arrays.py``
names the types of arrays.
"""
