"""Frames into a file: ffmpeg as a process, and whether it did what it was to do."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import threading
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from taskspec.missing import MissingLibraryError, library
from taskspec_runner.errors import InputError
from taskspec_runner.video.canvas import Image

#: Good to look at, and small.
_QUALITY = ["-crf", "21", "-preset", "medium", "-movflags", "+faststart"]
#: Options by which any frame is found without reading many others.
SEEKABLE = ("-g", "2", "-bf", "0")


def ffmpeg() -> str:
    """The program: the one of imageio-ffmpeg, or without that library what the system has.

    Raises:
        MissingLibraryError: there is neither.
        InputError: the library has no program for this system.
    """
    try:
        return str(library("imageio_ffmpeg", "a video").get_ffmpeg_exe())
    except MissingLibraryError:
        program = shutil.which("ffmpeg")
        if program is None:
            raise
        return program
    except RuntimeError as error:
        message = "cannot write a video: there is no ffmpeg; install imageio-ffmpeg, or ffmpeg"
        raise InputError(f"{message} and name it in IMAGEIO_FFMPEG_EXE") from error


class Encoder:
    """Writes frames as H.264 into a file that is there already."""

    def __init__(
        self, path: Path, width: int, height: int, fps: float, options: Sequence[str] = ()
    ) -> None:
        """Starts ffmpeg.

        Args:
            path: of the file; its suffix says the container.
            width, height: of every frame [px].
            fps: frames a second.
            options: of the encoder, beside those that there always are.

        Raises:
            OSError: ffmpeg cannot be started.
            MissingLibraryError: there is none.
        """
        rate = str(Fraction(fps).limit_denominator())
        source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", rate]
        coder = ["-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", *_QUALITY, *options]
        command = [ffmpeg(), "-y", "-v", "warning", *source, "-i", "-"]
        pipe = subprocess.PIPE
        # In a group of its own, so that Ctrl-C reaches the one who waits for it.
        self._process = subprocess.Popen(
            [*command, *coder, str(path)], stdin=pipe, stderr=pipe, process_group=0
        )
        self._words: list[str] = []
        # Read as they come, as a full pipe would stop it.
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if text := line.decode(errors="replace").strip():
                self._words.append(text)

    def write(self, frame: Image) -> None:
        """Takes a frame, (height, width, 3).

        Raises:
            OSError: ffmpeg has failed; the message has its last words.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(frame).data)
        except BrokenPipeError as error:
            raise self._failure() from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Waits until the file is complete; after an error ffmpeg is ended at once.

        Raises:
            OSError: ffmpeg has failed.
        """
        assert self._process.stdin is not None
        try:
            if kind is None:
                with contextlib.suppress(BrokenPipeError):
                    self._process.stdin.close()
                if self._process.wait():
                    raise self._failure()
        finally:
            if self._process.poll() is None:
                self._process.kill()
            with contextlib.suppress(OSError):
                self._process.stdin.close()
            self._process.wait()
            self._reader.join()
            assert self._process.stderr is not None
            self._process.stderr.close()

    def _failure(self) -> OSError:
        """The last message of ffmpeg."""
        self._process.wait()
        self._reader.join()
        said = f": {self._words[-1]}" if self._words else ""
        return OSError(None, f"the encoder failed with code {self._process.returncode}{said}")
