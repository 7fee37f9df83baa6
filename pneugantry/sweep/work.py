"""What a worker does with a case: the FMU comes to it as bytes, is loaded once, and every case runs
on it.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from pneugantry.analysis.metrics import Metrics, tracking_metrics
from pneugantry.jobs.job import Function
from pneugantry.sweep.cases import Case
from pneugantry.sweep.spec import OWN_FILES
from pneugantry.sweep.vary import changed
from pyfmi_runner.cache import cache_folder
from pyfmi_runner.fmu import FmuFile
from pyfmi_runner.log import write_atomically, write_log
from pyfmi_runner.run import run_scenario
from pyfmi_runner.scenario import scenario_from

__all__ = ["UNITS", "Simulation"]

UNITS = {"rmse_fn": "N", "me_fn": "N", "rmse_vt": "m/s", "me_vt": "m/s"}  # of Metrics
assert tuple(UNITS) == Metrics._fields


@dataclass(frozen=True)
class Simulation:
    """The study's part that all cases share, as a factory for workers that may share no disk with
    us.
    """

    name: str
    base: Mapping[str, Any]
    fmu_name: str
    fmu: bytes
    files: Mapping[str, bytes]  # a user's own edges and controllers: path in the cases -> content
    keep_logs: bool = False

    def __call__(self) -> Function:
        fmu = FmuFile.read(_unpacked(self.fmu_name, self.fmu))
        files = {
            path: str(_unpacked(Path(path).name, content)) for path, content in self.files.items()
        }
        return partial(self._run, fmu, files)

    def _run(
        self, fmu: FmuFile, files: Mapping[str, str], numbered: tuple[int, Case]
    ) -> dict[str, Any]:
        """One case: its metrics, or the reason why the run ended before its time; its log as
        Parquet where it is kept.
        """
        index, case = numbered
        table = changed(self.base, case) | {"name": f"{self.name}_{index:06d}"}
        for name in OWN_FILES:
            if table.get(name) in files:
                table[name] = files[table[name]]
        result = run_scenario(scenario_from(table), fmu)
        done = result.outcome == "done"
        metrics = tracking_metrics(result.log)._asdict() if done else {}
        row: dict[str, Any] = {
            **metrics,
            "status": "done" if done else "failed",
            "reason": result.reason,
        }
        if self.keep_logs:
            with tempfile.TemporaryDirectory() as folder:
                row["log"] = write_log(result.log, Path(folder) / "log.parquet").read_bytes()
        return row


def _unpacked(name: str, content: bytes) -> Path:
    """A file that came as bytes, in this machine's cache in a folder named by its hash."""
    path = cache_folder() / "shipped" / hashlib.sha256(content).hexdigest()[:24] / name
    if not path.is_file() or path.read_bytes() != content:
        write_atomically(path, lambda temporary: temporary.write_bytes(content))
    return path
