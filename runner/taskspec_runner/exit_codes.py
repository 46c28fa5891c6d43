"""Exit codes of all commands, one meaning each; docs/conventions.md has the table."""

WELL = 0
#: A run came to its end and an expectation was missed, or it oscillates or saturates without an
#: end; a sweep's expectation was missed; two runs differ; a folder is not as its run wrote it.
MISSED = 1
#: A task file is wrong, a command was used wrongly, or a file cannot be read or written.
WRONG = 2
INTERNAL = 3
#: A limit, or a guard of the simulator.
STOPPED = 4
#: Nothing was missed, and an expectation needs what was not recorded.
UNDECIDED = 5
#: A run ended in `fail`.
FAILED = 6
