"""Measurements: what the codec, the paper and the baselines do on given sequences."""
