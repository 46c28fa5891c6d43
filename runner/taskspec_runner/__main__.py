"""The command line as a module, which is how `mjpython` of macOS starts it."""

from taskspec_runner.cli import main

if __name__ == "__main__":
    main()
