"""A DC drive with an elastic joint: a user's own plant, from its model to its diagnosis."""
