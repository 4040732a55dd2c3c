"""Attacks: what a machine, a user or a file may do to cls-bench, done on purpose and counted.

``make attack`` carries all of them out; ``python -m tests.attacks KIND --only N --seed S`` repeats one trial. A share
of each runs in the ordinary tests (``test_attacks.py``). A trial is lost where a command hangs, prints a traceback,
ends with an exit code that is not the right one, gives a wrong value, loses more than was promised, takes more than
1 GB, or touches what it must not touch.
"""
