"""The stability atlas: each method next to its alternatives, from inputs that it handles well to inputs that
break it.
"""
