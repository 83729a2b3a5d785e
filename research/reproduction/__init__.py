"""Section 5 of Fang et al. 2024 done again on a rope of the same size, measured, and judged claim by claim."""
