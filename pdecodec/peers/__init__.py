"""Other ways to keep a mesh sequence, each measured on bytes that it decoded again.

Most are baselines of the field, written after their papers, without the tuning of a product; some call the package
that a pipeline would use. What a peer writes lives from its encoder to its decoder in one process: it is no file
format, and its decoders trust their input.
"""
