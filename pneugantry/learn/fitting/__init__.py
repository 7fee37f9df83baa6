"""Terms fitted jointly with everything else, held against each other, and judged."""
