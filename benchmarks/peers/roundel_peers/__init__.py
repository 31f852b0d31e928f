"""Published programs as methods of Roundel, a module each: their conventions are turned into ours here, and nothing else.

Each module imports its program at its top, so that a missing one is named in one line when its method is asked for.
"""
