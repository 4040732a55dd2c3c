"""The elements of a feel model, each in a file of its own; :class:`cls_bench.feel.model.Feel` lists them."""
