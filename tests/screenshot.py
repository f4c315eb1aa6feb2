"""Pictures of a page, taken by Chromium from outside (meshcat's capture hangs without a screen)."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

from pinotwin.errors import InputError

_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--force-device-scale-factor=1",
    "--mute-audio",
    "--disable-quic",
    "--virtual-time-budget=6000",
)
_SMALLEST = 3000  # [bytes]; a blank picture of this size compresses to less


def browser() -> str | None:
    """Return the path of an installed Chromium, or None."""
    return next((found for name in _NAMES if (found := shutil.which(name))), None)


def screenshot(
    page: str | Path, png: str | Path, size: tuple[int, int] = (1000, 750), patience: float = 90.0
) -> Path:
    """Take a picture of a page; return its path.

    Args:
        page: the HTML file.
        png: the picture.
        size: width and height [pixels].
        patience: longest time to wait [s].

    Raises:
        InputError: there is no Chromium, or it gave no picture.
    """
    program = browser()
    if program is None:
        raise InputError("no Chromium found for the picture; install it (Debian: apt install chromium)")
    png = Path(png).resolve()
    png.unlink(missing_ok=True)
    command = [f"--window-size={size[0]},{size[1]}", f"--screenshot={png}", Path(page).resolve().as_uri()]
    _run([program, *_FLAGS, *command], patience)
    if not png.is_file() or png.stat().st_size < _SMALLEST:
        raise InputError(f"{page}: Chromium gave no picture within {patience:.0f} s")
    return png


def dom(
    url: str, *flags: str, size: tuple[int, int] = (1200, 800), patience: float = 120.0
) -> tuple[str, list[str]]:
    """Return the text of a page after its scripts have run, and what they wrote to the console.

    Args:
        url: of the page.
        flags: more of Chromium's.
        size: width and height [pixels].
        patience: longest time to wait [s].
    """
    program = browser()
    if program is None:
        raise InputError("no Chromium found; install it (Debian: apt install chromium)")
    words = ["--enable-logging=stderr", *flags, f"--window-size={size[0]},{size[1]}", "--dump-dom", url]
    out, err = _run([program, *_FLAGS, *words], patience)
    return out, [line for line in err.splitlines() if ":CONSOLE" in line]


def _run(command: list[str], patience: float) -> tuple[str, str]:
    """Run Chromium in a process group of its own: it leaves helpers behind when it is ended by force."""
    with (
        tempfile.TemporaryDirectory() as profile,
        tempfile.TemporaryFile("w+") as out,
        tempfile.TemporaryFile("w+") as err,
    ):
        child = subprocess.Popen(
            [command[0], f"--user-data-dir={profile}", *command[1:]],
            stdout=out,
            stderr=err,
            start_new_session=True,
        )
        try:
            child.wait(timeout=patience)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
        out.seek(0)
        err.seek(0)
        return out.read(), err.read()
