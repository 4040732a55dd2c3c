"""Feel: the flight control system that the pilot is to feel: its elements, and how they are solved together."""
