"""Plants of other rigs, each with its study."""
