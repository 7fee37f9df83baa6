"""Front end: Modelica text → syntax tree → instances → a flat model in types of its own (ir.py)."""
