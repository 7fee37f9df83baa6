"""Parameter studies: a grid or a sample of scenarios, run anywhere, each result on disk as soon as
it exists.
"""
