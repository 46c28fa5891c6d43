"""The task language and its compiler: text in, controller out."""

__version__ = "0.1.0"
