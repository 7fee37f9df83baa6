"""How fast every path steps the FMU, side by side: our loops, a C master, other importers; and what
costs what.
"""
