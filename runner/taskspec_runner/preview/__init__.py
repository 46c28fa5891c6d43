"""One picture of a task before any run: the arm at its start, frames, surfaces, path, stages."""

from taskspec_runner.preview.picture import TaskPicture

__all__ = ["TaskPicture"]
