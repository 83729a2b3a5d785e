"""The codec: `.pdeanim` files from mesh sequences, and positions at any time from `.pdeanim` files.

Writing begins with ``encoding.py``, reading with ``opening.py``. ``settings.py`` has what an encode can be told,
``container.py`` the file with its table of section kinds, ``sections/`` what stands in each section. ``source.py``
opens the bytes and says what decoding may cost. ``decoder.py`` has `Animation`, the face of the native decoder, and
``array_evaluator.py`` evaluates with arrays of other libraries. ``resampling.py`` samples an animation at other times;
``paper_form.py`` gives coefficients as Fang et al. 2024 write them. ``editing.py`` cuts and joins files.
``checking.py`` finds what is wrong with a file, ``salvaging.py`` saves what is not; both read through ``mending.py``.
"""
