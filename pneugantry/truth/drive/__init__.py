"""Independent truth plant of a DC drive with an elastic joint: the second plant that judges the
diagnosis.
"""
