"""Independent truth plant of the pneumatic gantry rig: numbers, integrator, effects and campaigns written apart from the FMU chain.

Imports numpy, scipy, numba, pandas, pyarrow and the standard library only.
"""
