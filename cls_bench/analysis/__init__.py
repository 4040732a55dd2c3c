"""What a recording says: metrics, and linear models derived on their own. Imports neither tick nor control."""
