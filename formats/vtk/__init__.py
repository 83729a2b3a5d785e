"""Files of simulations: VTK's (VTU, PVD, VTP, legacy), XDMF and Exodus II.

Begin with ``files.py``, VTK's files in and out; what it does not read itself is left to meshio, and what that refuses
to ``library.py``, VTK itself in a worker process (extra ``vtk``). ``exodus.py`` reads HDF5 and netCDF. XDMF begins with
``xdmf.py``, which reads it by ``xdmf_document.py``, ``xdmf_grids.py``, ``xdmf_items.py`` and ``xdmf_cells.py``;
``xdmf_writer.py`` writes it. All of them turn cells of finite elements into faces and lines by ``cells.py``;
``motion.py`` says what moves a mesh.
"""
