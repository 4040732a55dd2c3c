"""What people write and the bench reads: files, TOML text, and one line for whatever is wrong in them."""
