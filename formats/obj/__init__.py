"""Formats with one mesh per file and one file per frame: OBJ, PLY, STL and OFF.

Begin with ``reader.py`` and ``writer.py``, which read and write OBJ sequences. ``text.py`` passes the text of an OBJ
file to the core, which parses it; ``model.py`` builds objects, groups and materials from the result. ``onto.py``
replaces the motion in an existing OBJ file. ``ply.py``, ``ply_writer.py`` and ``stl_off.py`` handle the other
formats.
"""
