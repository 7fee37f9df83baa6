"""What probabilities are worth: drawn rigs, and the weights of the decision."""
