"""Alembic archives of the Ogawa kind; needs the extra ``abc``.

Begin with ``reader.py`` and ``writer.py``. ``shapes.py`` finds what can be read of an archive and the transforms
above it. ``attributes.py`` and ``attributes_writer.py`` have what shapes carry beside positions, in and out, and
``values.py`` the way from the binding's arrays to NumPy's and back. ``inventory.py`` lists all that an archive holds,
with what becomes of it. ``onto.py`` copies an archive, with another motion of its shapes.
"""
