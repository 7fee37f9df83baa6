"""What records can tell before anything is fitted."""
