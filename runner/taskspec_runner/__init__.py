"""Execution of compiled tasks on a MuJoCo plant."""
