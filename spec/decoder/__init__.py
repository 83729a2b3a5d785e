"""An educational decoder of `.pdeanim` files: plain Python that follows ``spec/pdeanim.md``.

It shares no code with `pdecodec`. Read it together with the specification; tests check that both decoders give the
same results. It is slow, has no limits of its own, and holds everything in memory.

    python -m spec.decoder FILE.pdeanim            print what the file holds
    python -m spec.decoder FILE.pdeanim 0.25       print the vertex positions at 0.25 s, one per line

Modules in the order of decoding, with the sections of the specification that they follow: `fields` (1 to 3.2),
`rangecoder` (3.3 to 3.5, 3.7), `contexts` (3.5, 3.6, 3.8, 3.9), `animation` (4, 18), `mesh` (5, 7.2), `connectivity`
(5), `order` (6), `reference` (7), `curves` (8), `patches` (9), `groups` (10, 12), `space` (11), `timefunctions`
(13), `coefficients` (14), `residuals` (15), `motion` (16, 19), `attributes` and `wedges` (17), `fieldchunks` (24),
`storedfields` (25). `gltf` follows `spec/extension`.
"""
