"""Readers for libraries of Python: xarray finds its own by an entry point; import the one of meshio or trimesh.

They use the public interface of pdecodec alone, and nothing in pdecodec imports them.
"""
