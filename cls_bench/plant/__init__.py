"""The plant: what has mass, friction or a data sheet. Continuous, stepped by MuJoCo."""
