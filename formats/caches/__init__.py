"""Point caches, MDD and PC2: only positions and times; names, faces and attributes come from another file.

Both formats are in ``point_caches.py``.
"""
