"""Studies and checks that are not commands: solver, importers, soak, coverage."""
