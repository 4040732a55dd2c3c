"""What a recording shows: figures, pages and comparisons, made from the recording alone."""
