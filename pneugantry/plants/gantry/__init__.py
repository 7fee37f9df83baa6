"""The gantry as the diagnosis sees it."""
