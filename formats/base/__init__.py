"""What families of formats share; nothing here imports a family.

Begin with ``registry.py``: what a format is, and which one reads or writes a path; ``opening.py`` opens and writes by
it. ``frame_files.py`` finds the files of a sequence of one file a frame, ``frame_meshes.py`` reads and writes them.
Readers of scenes (Alembic, USD, glTF) share ``scene_reading.py``, writers of scenes ``scene_writing.py``; both use
``scene_space.py`` (axes, units, transforms), ``rigid_motion.py`` and ``normals.py``. ``onto.py`` puts motion onto a
file that is there. ``attribute_roles.py`` lists the names by which attributes pass from one format to another,
``times.py`` has how files store times. ``isolated.py`` reads in a worker process (:mod:`pdecodec.system.workers`).
``choosing.py`` and ``companions.py`` are for programs: frames and objects by name, the files that a path stands for.
"""
