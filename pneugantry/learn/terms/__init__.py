"""A term as the field writes it, as Modelica and as an effect."""
