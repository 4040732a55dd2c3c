"""What a recording says: metrics, and linear models derived apart from the simulation. Imports neither tick nor control."""
