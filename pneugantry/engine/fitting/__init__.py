"""A hypothesis at its best point: noise, descents, surveys, evidence."""
