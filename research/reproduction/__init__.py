"""Repeat section 5 of Fang et al. 2024 on a rope of the same size, measure it, and judge it claim by claim."""
