"""Stability laboratory: measure the loops on the running simulation, find the onset, and hold it against prediction."""
