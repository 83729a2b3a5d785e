"""Point caches, MDD and PC2: positions and times alone; names, faces and attributes come from another file.

Both formats are in ``point_caches.py``.
"""
