"""`python -m percept.cli` is the `percept` command."""

from percept.cli.app import main

if __name__ == "__main__":
    main()
