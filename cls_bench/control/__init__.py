"""The controller: what runs in the PLC and in the servo drive. Sampled; sees sensor samples only, writes commands only."""
