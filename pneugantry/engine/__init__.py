"""The diagnosis: a description of a plant and measured records in, causes of the gap out."""
