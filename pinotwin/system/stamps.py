"""When and how a result was made, for the foot of its page."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Any


def now() -> str:
    """Return the date and time."""
    return datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")


def stamp(began: float) -> dict[str, Any]:
    """Return the date, and the time taken since ``time.monotonic()`` was ``began``."""
    return {"date": now(), "seconds_taken": round(time.monotonic() - began, 1)}


def made(began: float, **options: Any) -> dict[str, Any]:
    """Return date, time taken since ``time.monotonic()`` was ``began``, and the options that were given."""
    return {**stamp(began), "options": {k: v for k, v in options.items() if v is not None}}
