"""The encoder: from a mesh sequence to the sections of a file, and what is searched on the way."""
