"""Hot loops, compiled with numba, each beside the plain numpy form that the tests compare it with.

``float(x)`` of a float32 stays a float32 in compiled code, where squares of coordinates underflow and overflow:
they say ``np.float64(x)``.
"""

from pathlib import Path

from pdecodec.kernels.compiledcode import forget_stale_code

_HERE = Path(__file__).parent
# A checkout keeps report/ beside pdecodec/, a wheel keeps it inside.
forget_stale_code(_HERE, tuple(folder / "report" / "baselines" for folder in (_HERE.parent.parent, _HERE.parent)))
