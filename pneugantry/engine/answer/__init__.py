"""From fits to a verdict: held-out records, replays, probabilities, where."""
