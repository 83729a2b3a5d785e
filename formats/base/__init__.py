"""Code that the families of formats share; nothing here imports a family.

Begin with ``registry.py``: what a format is, and which one reads or writes a path; ``opening.py`` opens and writes
with the format found there. ``frame_files.py`` finds the files of a sequence stored as one file per frame,
``frame_meshes.py`` reads them, ``frame_writing.py`` writes them. Readers of scenes (Alembic, USD, glTF) share
``scene_reading.py``, writers of scenes ``scene_writing.py``; both use ``scene_space.py`` (axes, units),
``transforms.py`` and ``normals.py``. ``rigid_fit.py`` fits rigid motion, of whole objects for ``rigid_motion.py`` and
of connected faces for ``rigid_pieces.py``. ``onto.py`` writes motion onto an existing file. ``attribute_roles.py``
lists the names by which attributes pass from one format to another, ``times.py`` handles times as files store them.
``isolated.py`` reads in a worker process (:mod:`pdecodec.system.workers`). ``choosing.py`` and ``companions.py`` are
for programs: they select frames and objects by name, and list the files that a path stands for.
"""
