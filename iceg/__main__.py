"""`python -m iceg` is `iceg`."""

import sys

from iceg.cli import main

sys.exit(main())
