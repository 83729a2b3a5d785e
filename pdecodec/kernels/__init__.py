"""Hot loops, compiled with numba, each beside the plain numpy form that the tests compare it with."""
