"""A reader for ParaView and VTK (``pdecodec_reader``), and PyVista's, which is built on it; see README.md.

It uses the public interface of pdecodec alone, and nothing in pdecodec imports it.
"""
