"""The encoder: a mesh sequence in, a `.pdeanim` file out, a group of frames in memory at a time.

Begin with ``pipeline.py``: it goes from group to group and gathers the sections. ``model.py`` chooses reference
frame and spatial basis, ``search.py`` the temporal basis and steps of a group, by the rates of ``cost.py``;
``temporal.py`` finds functions of time, ``fit.py`` fits and codes a group, ``quantise.py`` rounds coefficients, and
``refine.py`` improves the rounding. ``field/`` encodes fields. ``tuning.py`` lists what each effort searches,
``paper.py`` is the profile of the paper, ``report.py`` the report of an encode. ``pdecodec/codec/encoding.py`` has
:func:`pdecodec.encode`, which calls this encoder.
"""
