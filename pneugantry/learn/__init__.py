"""What no catalogue holds: the missing term of a plant, found, learnt and written back."""
