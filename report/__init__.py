"""Measure, chart and show clips: the parts of `pdecodec report`, `demo`, `view` and `serve`.

* ``clips/`` measures a person's own clips, compared with other coders, and writes pages about them; begin with
  ``clips/making.py``.
* ``charts/`` describes a chart once (``plots.py``) or draws meshes (``pictures.py``); ``vegalite.py`` renders,
  ``page.py`` writes the page.
* ``viewer/`` has a page that plays .pdeanim files (``view.py``), and a local server of a folder (``serve.py``).
* ``demo.py`` simulates, encodes, decodes, measures and draws the cube-rope.

`pdecodec.research` uses charts and pages from here, and nothing here uses it. Coders to compare with implement
``clips/baseline.py`` and are passed in. vl-convert, of the extra `report`, is loaded when something is drawn.
"""

if __name__ != "pdecodec.report":
    raise ImportError(f"import this package as pdecodec.report, not as {__name__}")
