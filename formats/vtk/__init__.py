"""Files of simulations: VTK's (VTU, PVD, VTP, legacy), XDMF and Exodus II.

Begin with ``files.py``, VTK's files in and out; what it does not read itself is left to meshio, and what that refuses
to ``library.py``, VTK itself in a child process (extra ``vtk``). ``xdmf.py`` and ``exodus.py`` read HDF5 and netCDF.
All of them turn cells of finite elements into faces and lines by ``cells.py``.
"""
