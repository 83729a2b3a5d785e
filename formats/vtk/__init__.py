"""Formats of simulations: VTK's (VTU, PVD, VTP, legacy, lists of files), XDMF and Exodus II.

Begin with ``files.py``. It reads VTK's files with ``xml_files.py``, else with meshio, and what that refuses with
``library.py``, which runs VTK itself in a worker process (extra ``vtk``); ``file_lists.py`` reads files that list
others, and ``writer.py`` writes. XDMF begins with ``xdmf.py``, which uses ``xdmf_document.py``, ``xdmf_grids.py``,
``xdmf_items.py``, ``xdmf_cells.py`` and ``xdmf_attributes.py``; ``xdmf_writer.py`` writes it. ``exodus.py`` reads
Exodus from HDF5 and netCDF with ``exodus_variables.py``; ``exodus_writer.py`` writes netCDF-4 (``netcdf_file.py``)
with the blocks of ``exodus_blocks.py``. ``written_fields.py`` gives writers the fields. All readers turn finite
elements into faces and lines with ``cells.py``; ``motion.py`` decides what moves a mesh.
"""
