"""What a log holds: records, sensors' errors, readings of signals."""
