"""The controller: what runs in the PLC and in the servo drive.

Sampled; it sees sensor samples only and writes commands only.
"""
