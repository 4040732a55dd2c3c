"""Many evaluations on all cores or on a cluster: sweeps of scenarios, stability maps, onset searches."""
