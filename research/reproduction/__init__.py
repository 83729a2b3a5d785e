"""Repeat section 5 of Fang et al. 2024 on a rope of the same size: measure the method, and judge the paper's
claims one by one.
"""
