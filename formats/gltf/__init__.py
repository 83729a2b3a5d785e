"""glTF 2.0: scenes as ``.glb`` or ``.gltf``, read at a frame rate, written as morph targets or moving nodes.

Begin with ``reader.py`` and ``writer.py``. Reading: ``file.py`` (JSON, buffers, accessors), ``types.py`` (what sort of
value stands where), ``compression.py`` (Draco, meshoptimizer), ``mesh_reader.py``, ``animation.py``. Writing:
``motion.py`` finds the targets that give an object's motion, by ``functions.py``, and rounds them; ``rigid_keys.py``
and ``rigid_objects.py`` make nodes and skins of what moves rigidly; ``mesh_writer.py`` and ``builder.py`` lay them out.
``materials.py`` takes materials from another file. ``onto.py`` puts motion onto a file that is there.
"""
