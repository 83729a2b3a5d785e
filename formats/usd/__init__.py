"""USD: stages as ``.usd``, ``.usda``, ``.usdc`` or packages (``.usdz``); needs the extra ``usd``.

Begin with ``reader.py`` and ``writer.py``. ``layers.py`` opens stages, ``composition.py`` reports missing files,
``inventory.py`` lists what a stage holds and what happens to it. ``walk.py`` finds the shapes that can be read,
including instances (``instances.py``); ``shapes.py`` opens meshes, surfaces of tetrahedra, curves and points,
``implicit.py`` implicit shapes as polygons; ``skinning.py`` deforms them, ``time_codes.py`` collects the time codes
of samples. ``attributes.py`` reads the data of prims other than points, ``attributes_writer.py`` writes it;
``metadata.py`` handles names of prims and metadata of stages. ``onto.py`` writes motion onto an existing stage.
"""
