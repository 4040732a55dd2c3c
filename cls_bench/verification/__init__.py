"""The plant held against results that were not made here: closed forms, references, independent integrations.

>>> from cls_bench.verification import render, verify
>>> rows = verify()                                      # doctest: +SKIP
>>> all(row.passed for row in rows)                      # doctest: +SKIP
True
"""

from cls_bench.verification.page import render
from cls_bench.verification.row import Row
from cls_bench.verification.runner import CASES, verify

__all__ = ["CASES", "Row", "render", "verify"]
