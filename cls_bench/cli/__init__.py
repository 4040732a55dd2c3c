"""The command line: ``cls-bench``.

One module for each group of commands. They import what they need when they run, so that ``--help`` waits for nothing;
and nothing at all is imported here before signals and standard streams are safe.
"""

from cls_bench.cli.entry import Entry

main = Entry()
"""Carries out ``sys.argv`` when it is called; in all else the click group of :mod:`cls_bench.cli.commands`."""
