"""The plant held against results that were not made here: closed forms, references, independent integrations."""
