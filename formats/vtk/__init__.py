"""Files of simulations: VTK's (VTU, PVD, VTP, legacy, lists of them), XDMF and Exodus II.

Begin with ``files.py``, which reads VTK's files by ``xml_files.py``, else by meshio, and what that refuses by
``library.py``, VTK itself in a worker process (extra ``vtk``); ``file_lists.py`` has files that list others, and
``writer.py`` writes. XDMF begins with ``xdmf.py``, which reads it by ``xdmf_document.py``, ``xdmf_grids.py``,
``xdmf_items.py`` and ``xdmf_cells.py``; ``xdmf_writer.py`` writes it. ``exodus.py`` reads HDF5 and netCDF. All of them
turn cells of finite elements into faces and lines by ``cells.py``; ``motion.py`` says what moves a mesh.
"""
