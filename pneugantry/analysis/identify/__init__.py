"""Identification of the plant from a campaign: the thesis' own tests, and one joint fit by command
replay.
"""
