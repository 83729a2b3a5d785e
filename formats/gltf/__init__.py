"""glTF 2.0: read scenes from ``.glb`` and ``.gltf`` at a frame rate; write motion as morph targets or moving nodes.

Begin with ``reader.py`` and ``writer.py``. Reading: ``file.py`` (JSON, buffers, accessors), ``types.py`` (checks the
type of every value in the JSON), ``compression.py`` (Draco, meshoptimizer), ``mesh_reader.py``, ``animation.py``.
Writing: ``motion.py`` finds and rounds the morph targets of an object's motion, with the functions of time that
``functions.py`` fits; ``rigid_keys.py`` and ``rigid_objects.py`` turn rigid motion into moving nodes and skins;
``mesh_writer.py`` and ``builder.py`` lay the file out; ``delivered_mesh.py`` and ``packing.py`` write smaller
files for viewers. ``animated_scene.py`` has the nodes and animations that ``writer.py`` shares with ``onto.py``,
which replaces the motion of an existing file. ``materials.py`` copies materials from another file, and
``vertex_textures.py`` writes motion as textures next to a mesh.
"""
