"""Named arrays in one file, NumPy's NPZ and HDF5, which keep everything.

Begin with ``npz.py`` or ``hdf5.py``. The layout of the arrays, which both share with reading in a child process, is
:mod:`pdecodec.formats.base.object_arrays`.
"""
