"""The blind check on sealed cases of the independent truth plant."""
