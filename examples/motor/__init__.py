"""A motor with data in the repository: the plant of the tutorial "My own plant"."""
