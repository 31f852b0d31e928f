"""Published programs as methods of Roundel, a module each: it only turns their conventions into ours.

Each module imports its program at its top, so that a missing one is named in one line when its method is asked for.
"""
