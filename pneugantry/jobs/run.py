"""Jobs here or on a cluster, by one call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from modelica_fmu.errors import InputError
from pneugantry.jobs.job import Ended, Factory, Job
from pneugantry.jobs.local import run_local

__all__ = ["run_jobs"]


def run_jobs(
    factory: Factory, jobs: Sequence[Job], *, workers: int = 2, scheduler: str | None = None
) -> Iterator[Ended]:
    """The jobs' ends as they come, in any order, each job once.

    workers: processes here; scheduler: address of a Dask scheduler, which takes their place. Raises
    InputError for unusable ones, RunError where workers cannot be made ready.
    """
    if scheduler is None:
        if workers < 1:
            raise InputError(
                f"is {workers}, expected >= 1", field="--workers", hint="give at least one"
            )
        return run_local(factory, jobs, workers)
    try:
        from pneugantry.jobs.cluster import run_cluster
    except ImportError as error:
        raise InputError(
            f"needs the package {error.name}",
            field="--scheduler",
            hint='pip install "pneugantry[cluster]"',
        ) from None
    return run_cluster(factory, jobs, scheduler)
