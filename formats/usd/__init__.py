"""USD: stages as ``.usd``, ``.usda``, ``.usdc`` or packages (``.usdz``); needs the extra ``usd``.

Begin with ``reader.py`` and ``writer.py``. ``layers.py`` opens stages, ``composition.py`` names files that are not
there, ``inventory.py`` lists what a stage holds and what becomes of it. ``walk.py`` finds what can be read, instances
(``instances.py``) among it; ``shapes.py`` opens meshes, surfaces of tetrahedra, curves and points, ``implicit.py``
implicit shapes as polygons; ``skinning.py`` deforms them, ``time_codes.py`` says when anything is sampled.
``attributes.py`` reads what prims carry beside points, ``attributes_writer.py`` writes it; ``metadata.py`` has names
of prims and what stages say of time and space. ``onto.py`` puts motion onto a stage that is there.
"""
