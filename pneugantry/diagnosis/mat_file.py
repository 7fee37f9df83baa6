"""MATLAB files, by the reader that logs use too."""

from pyfmi_runner.mat_file import read_mat

__all__ = ["read_mat"]
