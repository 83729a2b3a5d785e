"""Formats of one file a frame and one mesh a file: OBJ, PLY, STL and OFF.

Begin with ``reader.py`` and ``writer.py``: OBJ sequences in and out. ``model.py`` makes objects, groups and materials
of what an OBJ file says, ``text.py`` hands its text to the core, which parses it. ``onto.py`` puts motion onto the text
of an OBJ file. ``ply.py``, ``ply_writer.py`` and ``stl_off.py`` have the others.
"""
