"""Read and write Alembic archives of the Ogawa kind; needs the extra ``abc``.

Begin with ``reader.py`` and ``writer.py``. ``shapes.py`` finds the readable shapes of an archive and the transforms
above them. ``attributes.py`` reads and ``attributes_writer.py`` writes the other data of shapes; ``values.py``
converts between arrays of the Python binding and NumPy's. ``inventory.py`` lists everything in an archive and what
becomes of it. ``onto.py`` copies an archive with another motion of its shapes.
"""
