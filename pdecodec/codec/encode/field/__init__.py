"""The encoder of fields, values on vertices, faces or corners that change in time: sections FLDS and FDAT.

Begin with ``sections.py``, which goes through the fields of a sequence. ``computed.py`` recognises those that a decoder
can compute; ``chunks.py`` turns the values of the others into whole numbers and chooses how they are coded.
"""
