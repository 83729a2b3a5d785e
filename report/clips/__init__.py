"""`pdecodec report`: how small, how exact and how fast, on a person's own data, beside what else could be used."""
