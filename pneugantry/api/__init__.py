"""What `import pneugantry as pg` offers: each command as a function, results as typed values.

The command line is thin over the same functions. `pneugantry/__init__.py` imports them when they
are first used.
"""
