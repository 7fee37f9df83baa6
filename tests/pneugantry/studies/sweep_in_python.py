"""`pneugantry` whose sweeps step in the Python loop: the same bits, and no worker spends seconds on
compiling. Workers load it too.
"""

from functools import partial

from pneugantry.cli import main
from pneugantry.sweep import work

work.run_scenario = partial(work.run_scenario, compiled=False)

if __name__ == "__main__":
    raise SystemExit(main())
