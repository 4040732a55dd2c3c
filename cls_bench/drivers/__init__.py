"""Drivers of a bench: who tells it what the hand does and what changes. The bench knows none of them."""
