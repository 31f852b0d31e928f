"""The solver's inner loops, compiled by Numba: plain loops over pixels and points, without Python objects.

compiled: `compiled`: compile a function with Numba once, keep the result on disk, and say so while it happens
"""
