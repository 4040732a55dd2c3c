"""``python -m cls_bench``: the command line."""

from cls_bench.cli import main

if __name__ == "__main__":
    main()
