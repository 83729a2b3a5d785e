"""The encoder of fields, values on vertices, faces or corners that change in time: sections FLDS and FDAT.

Begin with ``sections.py``, which goes through the fields of a sequence. ``computed.py`` recognises fields that a
decoder can compute; ``chunks.py`` turns the values of other fields into whole numbers and chooses their coding.
"""
