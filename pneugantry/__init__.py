"""PneuGantry: co-simulation of a pneumatic gantry robot, and diagnosis of its sim-to-real gap."""

from __future__ import annotations

__all__ = ["__version__"]


def __getattr__(name: str) -> str:
    """`__version__`, read from the installed package when it is first asked for."""
    if name == "__version__":
        from importlib.metadata import version

        return version("pneugantry")
    raise AttributeError(f"module 'pneugantry' has no attribute {name!r}")
