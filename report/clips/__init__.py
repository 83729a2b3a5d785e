"""Measure a person's own clips: size, error and speed next to the alternatives; this is `pdecodec report`."""
