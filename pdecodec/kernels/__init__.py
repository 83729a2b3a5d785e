"""Hot loops, compiled with numba, each beside the plain numpy form that the tests compare it with.

``float(x)`` of a float32 stays a float32 in compiled code, where squares of coordinates underflow and overflow:
they say ``np.float64(x)``.
"""
