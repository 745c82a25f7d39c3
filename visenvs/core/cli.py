"""What every command line shares: options in, one clear line instead of a traceback."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import NoReturn, TypeVar

Options = TypeVar("Options")

FAILED, INTERRUPTED = 1, 130


def launch(program: str, options: type[Options], run: Callable[[Options], None]) -> NoReturn:
    """Parse the command line into `options`, run, and leave with an exit code.

    A ValueError, OSError, ImportError or Ctrl-C becomes one line on stderr and a code other than 0.
    OpenCV gets one thread unless the user says otherwise: pictures are small here, and a second
    thread takes as much CPU time as the first and wins nothing.
    """
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

    def command() -> None:
        import tyro

        run(tyro.cli(options, prog=f"python -m {program}", description=run.__doc__))

    finish(command)


def finish(command: Callable[[], None]) -> NoReturn:
    """Run a command and leave with its exit code."""
    sys.exit(guarded(command))


def guarded(command: Callable[[], None]) -> int:
    """Exit code of a command: 0, or 1 (error) or 130 (Ctrl-C) with one line on stderr."""
    try:
        command()
    except KeyboardInterrupt as interrupt:
        print(f"interrupted: {interrupt}" if str(interrupt) else "interrupted", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError, ImportError) as error:
        print("error: " + " ".join(str(error).split()), file=sys.stderr)
        return FAILED
    return 0
