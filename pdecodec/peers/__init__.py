"""Other ways to keep a mesh sequence, each measured on bytes that it decoded again.

Most are baselines of the field, written after their papers, without the tuning of a product; some call the package
that a pipeline would use. What a peer writes lives from its encoder to its decoder in one process: it is no file
format, and its decoders trust their input.

They may take fewer bytes than other implementations of the same papers, by 5 to 20 % on meshes of some thousand
vertices: models of the range coder adapt from one mode to the next where tables would be sent, every column takes the
predictor that suits it, and the length that just keeps the bound is searched to 2 %. Those with corrections take 20 to
80 % fewer than with a step chosen beforehand: the transform's step is searched, and only vertices beyond the bound are
corrected.
"""
