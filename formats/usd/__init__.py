"""USD: stages as ``.usd``, ``.usda``, ``.usdc`` or packages (``.usdz``); needs the extra ``usd``.

Begin with ``reader.py`` and ``writer.py``. ``composition.py`` opens stages and names files that are not there.
``walk.py`` finds what can be read of a stage, instances (``instances.py``)
among it; ``shapes.py`` opens meshes, surfaces of tetrahedra, curves and points, ``implicit.py`` implicit shapes as
polygons; ``skinning.py`` deforms them. ``attributes.py`` reads what prims carry beside points, ``attributes_writer.py``
writes it; ``metadata.py`` has names of prims and what stages say of time and space. ``onto.py`` puts motion onto a
stage that is there.
"""
