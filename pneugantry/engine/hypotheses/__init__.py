"""What may be wrong: effects of a catalogue, and the coordinates in which they are fitted."""
