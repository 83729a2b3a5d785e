"""Formats of named arrays in one file, NumPy's NPZ and HDF5, which store everything.

Begin with ``npz.py`` or ``hdf5.py``. The layout of the arrays is :mod:`pdecodec.formats.base.object_arrays`, which
also serves to pass sequences between processes.
"""
