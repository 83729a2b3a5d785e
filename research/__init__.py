"""What was measured and why: the paper reproduced, where methods lose stability, and other codecs beside this one.

Nothing that encodes or decodes depends on this package. Begin with ``reproduction/report.py`` (section 5 of the paper,
judged claim by claim), ``stability/atlas.py`` (where each method breaks) or ``baselines/__init__.py`` (other codecs).
``bench.py`` and ``growth.py`` measure speed and memory.
"""
