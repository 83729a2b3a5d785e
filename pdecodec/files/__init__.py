"""Whole files: cut and joined, checked, put together again where they are damaged."""
