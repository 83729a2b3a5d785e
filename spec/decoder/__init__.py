"""An educational decoder of `.pdeanim` files: plain Python, along ``spec/pdeanim.md``.

It shares no code with `pdecodec` and exists to be read beside the specification and to check it: the tests
compare what both decode to the last bit. It is slow, has no limits of its own, and holds everything in memory.

    python -m spec.decoder FILE.pdeanim            what the file holds
    python -m spec.decoder FILE.pdeanim 0.25       the vertex positions at 0.25 s, a line each

Modules, in the order of a decode: `fields` (sections 1 to 4 of the specification), `mesh` (5, 6, 13); of version 1
`curves` (7), `shape` (8, 9), `motion` (10 to 12); of version 2 `rangecoder` (19), `polygons`, `weld` and `faces` (20),
`patches` (22), `space` (23, 24), `levels` (25), `modes` (26), `corrections` (27), `spline` and `groups` (21, 28).
"""
