"""Compiled kernels on disk, and the first compilation after an installation.

first_compilation: The first compilation after an installation: a word to the user, and other processes that compile a
    share of it
kernel_cache: Where compiled kernels are kept on disk: Numba's cache, valid for all sources that a kernel may be made
    of
"""
