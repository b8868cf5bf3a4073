"""Wall times as people and schedulers write them."""

from __future__ import annotations

import re

EXAMPLES = "90, 90s, 10m, 2h, 1h30m, 01:30:00 or 1-12:00:00"
_TIME = re.compile(r"(?:([\d.]+)d)?(?:([\d.]+)h)?(?:([\d.]+)m)?(?:([\d.]+)s?)?", re.ASCII | re.IGNORECASE)
_SCHEDULED = re.compile(r"(?:(\d+)-(\d+)(?::(\d+)(?::(\d+))?)?|(?:(\d+):)?(\d+):(\d+))", re.ASCII)
_SECONDS = (86400.0, 3600.0, 60.0, 1.0)


def wall_seconds(text: str) -> float | None:
    """Seconds of 90, 90s, 10m, 2h, 1h30m, 1d; of schedulers' 10:00, 1:30:00, 1-12, 1-12:00:00. None: no time > 0."""
    text = text.strip()
    scheduled = _SCHEDULED.fullmatch(text)
    if scheduled:
        total = _of_scheduler(scheduled)
        if total > 0.0:
            return total
    match = _TIME.fullmatch(text)
    try:
        parts = [float(part or 0) for part in match.groups()] if match else [0.0]
    except ValueError:
        return None
    total = sum(part * unit for part, unit in zip(parts, _SECONDS[-len(parts) :], strict=True))
    return total if 0.0 < total < float("inf") else None


def _of_scheduler(match: re.Match) -> float:
    """Seconds of D-HH[:MM[:SS]] or [HH:]MM:SS."""
    days, day_hours, day_minutes, day_seconds, *clock = (float(part or 0) for part in match.groups())
    parts = (days, day_hours, day_minutes, day_seconds) if match.group(1) else (0.0, *clock)
    return sum(part * unit for part, unit in zip(parts, _SECONDS, strict=True))


def clock(seconds: float) -> str:
    """HH:MM:SS, with more than 24 hours where it takes them."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02d}:{minutes:02d}:{rest:02d}"
