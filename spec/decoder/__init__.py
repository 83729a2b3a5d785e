"""An educational decoder of `.pdeanim` files: plain Python, along ``spec/pdeanim.md``.

It shares no code with `pdecodec` and exists to be read beside the specification and to check it: the tests
compare what both decode. It is slow, has no limits of its own, and holds everything in memory.

    python -m spec.decoder FILE.pdeanim            what the file holds
    python -m spec.decoder FILE.pdeanim 0.25       the vertex positions at 0.25 s, a line each

Modules, in the order of a decode, with the section that each follows: `fields` (2, 3.1, 3.2), `rangecoder` (3.3 to
3.7), `contexts` (3.6, 3.8), `texts` (3.9), `mesh` (4, 18), `connectivity` and `surface` (5), `order` (6), `polygons`,
`weld` and `reference` (7), `curves` and `grids` (8), `patches` (9), `groups` (10, 12), `space` and `shape` (11),
`timefunctions` and `closedform` (13), `coefficients` (14), `residuals` (15), `spline` and `motion` (16), `attributes`,
`wedges` and `wedgevalues` (17).
"""
