"""Random models of the whole language, run by the compiler's C and by an interpreter."""
