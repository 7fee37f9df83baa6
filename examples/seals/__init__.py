"""Really measured friction of pneumatic seals at four pressures: what grows with pressure."""
