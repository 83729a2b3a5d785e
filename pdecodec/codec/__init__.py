"""The codec: `.pdeanim` files from mesh sequences, and positions at any time from `.pdeanim` files.

Writing begins with ``encoding.py``, reading with ``opening.py``. ``settings.py`` has the settings of an encode,
``container.py`` the file with its table of sections, ``sections/`` one module per section. ``source.py`` opens the
bytes and limits the cost of decoding. ``decoder.py`` has `Animation`, which wraps the native decoder, and
``array_evaluator.py`` evaluates with other array libraries. ``resampling.py`` samples an animation at other times;
``paper_form.py`` gives coefficients as Fang et al. 2024 write them. ``editing.py`` cuts and joins files.
``checking.py`` lists faults of a file, ``salvaging.py`` saves what is undamaged; both read through ``mending.py``.
"""
