"""The answer of a diagnosis for a reader: a sentence, and one page with pictures."""
