"""The sections of a file, one module each; the order is that of the file.

``description.py``: SEQN (times, names, jumps) and META (remarks). ``connectivity.py``: CONN and ORDR.
``reference.py``: REST. ``space_basis.py``: MODL, on the patches and curves of ``elements.py``. ``groups.py``: GRUP,
the table of groups, and COEF. ``time_functions.py``: TIME; ``closed_form.py``: the functions of Eqs. 12 to 16.
``residuals.py``: CORR. ``attributes.py``: ATTR. ``bytestream.py`` reads and writes fields. The coders are native:
`core/sections/`. The table of all section kinds is in `codec/container.py`.
"""
