"""`python -m pneugantry`."""

from pneugantry.cli import main

raise SystemExit(main())
