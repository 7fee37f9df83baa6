"""Independent truth plant of the gantry rig: numbers, integrator, effects and campaigns apart from
the FMU chain.

Imports numpy, scipy, numba, pandas, pyarrow and the standard library only.
"""
