"""``python -m fieldlink``: the command, where its script is not on the path."""

from fieldlink.cli import main

if __name__ == "__main__":
    main()
