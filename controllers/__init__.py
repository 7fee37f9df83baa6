"""Controllers of the pneumatic gantry: parameters, state and a kernel that runs in Python and in a
compiled loop.
"""
