"""``python -m benchmarks [pytest's options]``; ``--write-page`` puts the table into docs/performance.md."""

import sys
from pathlib import Path

import pytest

OPTIONS = ("-p", "no:xdist", "--benchmark-disable-gc", "--benchmark-columns=median,rounds", "--benchmark-sort=name")

sys.exit(pytest.main([str(Path(__file__).parent), *OPTIONS, *sys.argv[1:]]))
