"""`python -m taskspec`: the command line, which is the runner's."""

from taskspec_runner.cli import main

if __name__ == "__main__":
    main()
