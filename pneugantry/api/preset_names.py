"""Conditions of runs by name, in words. Imports nothing: help asks for them."""

__all__ = ["PRESETS"]

PRESETS = {
    "campaign": "as the measuring campaigns contour: the plant's own parameters, 9 s of contour",
    "thesis": "as the leaderboard of `pneugantry thesis`: contact of 5e4 N/m, DDFM friction on z, "
    "surface finish, scored over the thesis' window",
    "thesis_converter": "as thesis, read through the rig's converter: 12 bits over +-10 V",
}
