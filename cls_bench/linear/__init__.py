"""Linear theory of the whole bench for small motion about neutral, derived on its own from the book, for any rig.

Nothing here is taken from the simulation: the plant is written down as coupled inertias (:mod:`.plant`, with the
linkage's levers from :mod:`.linkage` and the hand from :mod:`.hand`) and solved exactly with the matrix exponential;
the sampled side is the block diagram of thesis figures 3.31 to 3.33 and 3.38 with its delays (:mod:`.cycle`, on the
linear forms of :mod:`.forms`). So agreement with the simulation is evidence for both.

The plant has the true values of its parameters. Drive and PLC have what they read in reality: nameplate, ``drive``,
``plc`` and ``feel``, and the rates.

:mod:`.bench` puts both together and tells growth rate and Nyquist's encirclements; :mod:`.prediction` gives verdict,
margins and the thesis's rule, :mod:`.least` the least inertia that any grip leaves stable, :mod:`.variation` what is
varied to find an onset.
"""
