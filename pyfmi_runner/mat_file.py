"""A MATLAB file's numeric arrays, read in a process of its own: `python -m pyfmi_runner.mat_file
FILE.mat OUT.npz`.

scipy's reader ends the whole process on some damaged files, and compressed ones may unfold to any
size.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["read_mat"]

MEMORY = 8 * 2**30  # bytes of address space, where the system has such limits
LONGEST = 120  # s
PREFIX = "array_"  # a name must not be that of an argument of numpy's writer


def read_mat(file: Path) -> dict[str, NDArray[np.generic]]:
    """Arrays of numbers by name. Raises ValueError with the reader's own words, or with how it
    ended.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "columns.npz"
        command = [sys.executable, "-m", "pyfmi_runner.mat_file", str(file), str(out)]
        try:
            done = subprocess.run(command, capture_output=True, timeout=LONGEST, check=False)
        except subprocess.TimeoutExpired:
            raise ValueError(f"the reader takes longer than {LONGEST} s") from None
        if done.returncode != 0:
            said = done.stderr.decode(errors="replace").strip().splitlines()
            raise ValueError(
                said[-1]
                if said and done.returncode > 0
                else f"the reader ended with {done.returncode}"
            )
        with np.load(out, allow_pickle=False) as arrays:
            return {name.removeprefix(PREFIX): values for name, values in arrays.items()}


def _main(file: str, out: str) -> None:
    from scipy.io import loadmat  # for the process that reads alone

    with contextlib.suppress(ImportError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    arrays: dict[str, NDArray[np.generic]] = {}
    for name, values in loadmat(file).items():
        if not name.startswith("__"):
            arrays |= _numeric(PREFIX + name, np.asarray(values))
    np.savez(out, allow_pickle=False, **arrays)


def _numeric(name: str, values: NDArray[np.generic]) -> dict[str, NDArray[np.generic]]:
    """The arrays of numbers in a variable; those of a structure as `name.field`."""
    if values.dtype.kind in "biuf":
        return {name: values}
    found: dict[str, NDArray[np.generic]] = {}
    names = values.dtype.names or ()
    if values.size == 1:
        for field in names:
            found |= _numeric(f"{name}.{field}", np.asarray(np.array(values)[field].item()))
    return found


if __name__ == "__main__":
    _main(*sys.argv[1:])
