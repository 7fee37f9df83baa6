"""Independent cases in worker processes, here or on a cluster; a worker that dies loses the case it
was at, and no other.
"""
