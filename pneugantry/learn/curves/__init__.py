"""Curves of one variable, and what remembers."""
