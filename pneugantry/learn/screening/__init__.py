"""Which equation lacks a term, and of what variable: linear about a fit."""
