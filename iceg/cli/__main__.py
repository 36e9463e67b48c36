"""`python -m iceg.cli` is `iceg`."""

import sys

from iceg.cli import main

sys.exit(main())
